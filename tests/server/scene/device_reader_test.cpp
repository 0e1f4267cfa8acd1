// Every shipped device is read, and its limits are consistent with each other.
#include "server/scene/device_reader.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "server/files/input_error.h"
#include "server/files/paths.h"

namespace hapticd {
namespace {

TEST(DeviceReader, ShippedDevices) {
  int files = 0;
  for (const auto& entry :
       std::filesystem::directory_iterator(std::filesystem::path(SOURCE_DIR) / "config/devices")) {
    if (entry.path().extension() != ".yaml") continue;
    SCOPED_TRACE(entry.path());
    const DeviceFile device = read_device(entry.path());
    EXPECT_EQ(read_device(device_path(entry.path().stem().string(), "")).name, device.name);
    // The slew limit is the largest stiffness at a hand's 0.5 m/s, or what keeps below it.
    EXPECT_NEAR(device.limits.max_force_rate, 0.5 * device.max_stiffness, 1e-9);
    EXPECT_GT(device.limits.max_force_rate, 10 * device.limits.max_force);
    EXPECT_GE(device.limits.max_speed, 1.5);
    ++files;
  }
  EXPECT_EQ(files, 6);
}

TEST(DeviceReader, TouchHasItsFigures) {
  const DeviceFile touch = read_device(device_path("touch", ""));
  EXPECT_EQ(touch.limits.max_force, 3.3);
  EXPECT_EQ(touch.max_stiffness, 400);
  EXPECT_EQ(touch.limits.damping, 4);
  EXPECT_EQ(touch.limits.workspace_radius, 0.075);
  EXPECT_EQ(touch.limits.max_torque, 0);
  EXPECT_EQ(touch.limits.quantum, 55e-6);
  EXPECT_EQ(read_device(device_path("falcon", "")).limits.quantum, 0);  // not said
}

TEST(Paths, TheEnvironmentWins) {
  ASSERT_EQ(setenv("HAPTICD_CONFIG_DIR", "/elsewhere", 1), 0);
  EXPECT_EQ(config_directory(), "/elsewhere");
  EXPECT_EQ(device_path("touch", "/scene"), "/elsewhere/devices/touch.yaml");
  unsetenv("HAPTICD_CONFIG_DIR");
  EXPECT_EQ(config_directory().filename(), "config");
  EXPECT_EQ(device_path("my.yaml", "/scene"), "/scene/my.yaml");
  EXPECT_EQ(device_path("/x/my.yaml", "/scene"), "/x/my.yaml");
}

TEST(InputErrorText, NamesFileLineKey) {
  EXPECT_STREQ(InputError("a.yaml", 3, "k", "is wrong").what(), "a.yaml:3: k: is wrong");
  EXPECT_STREQ(InputError("a.msh", 0, "$Nodes", "is wrong").what(), "a.msh: $Nodes: is wrong");
  EXPECT_STREQ(InputError("a", 0, "", "no such file").what(), "a: no such file");
}

}  // namespace
}  // namespace hapticd
