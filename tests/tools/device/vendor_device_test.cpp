// What each kind makes of its library's answers, in this process: units, axes, buttons, names, what is missing.
#include <gtest/gtest.h>

#include "tests/support/devices/fake_device.h"
#include "tests/tools/device/fake_inverse3.h"
#include "tests/tools/run_command.h"
#include "tools/device/device_kinds.h"
#include "tools/device/force_dimension.h"
#include "tools/device/frames.h"
#include "tools/device/inverse3.h"
#include "tools/device/inverse3_messages.h"
#include "tools/device/openhaptics.h"
#include "tools/device/shared_library.h"

namespace hapticd {
namespace {

constexpr double half = 0.70710678118654752;
using Rows = std::array<std::array<double, 3>, 3>;
constexpr Rows identity{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

// At rest each maker's shaft points to the person: the house's −y. Then z goes to −y, and y to z.
constexpr std::array<double, 4> at_rest{half, 0, 0, half};

void expect_near(const std::array<double, 4>& a, const std::array<double, 4>& b) {
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(a[i], b[i], 1e-12) << i;
}
void expect_near(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], 1e-12) << i;
}

class DeviceUnits : public testing::Test {
 protected:
  DeviceUnits() {
    setenv("FAKE_DEVICE", scratch_.file("device").c_str(), 1);
    fake_ = &fake_device(true);
  }
  void put(double x, double y, double z) {
    fake_->position[0] = x;
    fake_->position[1] = y;
    fake_->position[2] = z;
  }
  Sample sampled(VendorDevice& device) const {
    Sample sample;
    fake_sleep(20'000'000);
    EXPECT_TRUE(device.sample(sample)) << device.fault();
    return sample;
  }
  const ScratchDirectory scratch_;
  FakeDevice* fake_ = nullptr;
};

TEST(DeviceFrames, AQuaternionTurnsAsItsMatrixDoes) {
  for (int i = 0; i < 1000; ++i) {
    std::array<double, 4> q{std::sin(1.0 + i), std::sin(2.0 * i), std::cos(3.0 * i), 0.1 * std::cos(5.0 * i)};
    double n = 0;
    for (const double c : q) n += c * c;
    for (double& c : q) c /= (q[3] < 0 ? -1 : 1) * std::sqrt(n);
    const auto [x, y, z, w] = q;
    const Rotation r{{{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
                      {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
                      {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}}};
    expect_near(quaternion(r), q);
  }
}

TEST(DeviceFrames, ToTheMakerAndBackIsTheSame) {
  constexpr AxisMap map = {{2, -1, 3}};
  expect_near(map.to_house(map.to_maker({1, 2, 3})), {1, 2, 3});
  expect_near(map.to_house({5, 6, 7}), {6, -5, 7});
}

TEST_F(DeviceUnits, OpenHaptics) {
  put(1, 2, 3);
  fake_->rotation = identity;
  fake_->buttons = 3;
  const auto device = open_openhaptics(fake_openhaptics, "");
  EXPECT_EQ(device->name(), "Touch, 2016-0042");
  Sample s = sampled(*device);
  expect_near(s.reading.position, {0.001, -0.003, 0.002});
  expect_near(s.reading.orientation, at_rest);
  EXPECT_EQ(s.reading.buttons, 3u);
  EXPECT_STREQ(device->asks(), "");
  // A quarter turn about HDAPI's y, which is up: the shaft points to the right.
  fake_->rotation = {{{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}}};
  s = sampled(*device);
  expect_near(s.reading.orientation, {0.5, 0.5, 0.5, 0.5});
  fake_->calibrated = false;
  sampled(*device);
  EXPECT_NE(std::string(device->asks()).find("inkwell"), std::string::npos);
  EXPECT_THROW(open_openhaptics(fake_openhaptics, "Left Device"), std::runtime_error);
}

TEST_F(DeviceUnits, ForceDimension) {
  put(0.1, 0.2, 0.3);
  fake_->rotation = identity;
  fake_->buttons = 1;
  {
    const auto device = open_force_dimension(fake_force_dimension, "0", false);
    EXPECT_EQ(device->name(), "omega.6, serial number 1042, left-handed");
    Sample s = sampled(*device);
    expect_near(s.reading.position, {0.2, -0.1, 0.3});
    expect_near(s.reading.orientation, at_rest);
    EXPECT_EQ(s.reading.buttons, 1u);
    // A quarter turn about DHD's z, which is up: the shaft points to the right.
    fake_->rotation = {{{0, -1, 0}, {1, 0, 0}, {0, 0, 1}}};
    s = sampled(*device);
    expect_near(s.reading.orientation, {0.5, 0.5, 0.5, 0.5});
    fake_->calibrated = false;
    sampled(*device);
    EXPECT_NE(std::string(device->asks()).find("calibration"), std::string::npos);
  }
  EXPECT_FALSE(fake_->motors);
  EXPECT_THROW(open_force_dimension(fake_force_dimension, "0", true), std::runtime_error);  // no Falcon
  EXPECT_THROW(open_force_dimension(fake_force_dimension, "1", false), std::runtime_error);
  EXPECT_THROW(open_force_dimension(fake_force_dimension, "one", false), std::invalid_argument);
}

TEST_F(DeviceUnits, Inverse3OfEitherVersionOfItsService) {
  for (const bool newer : {true, false}) {
    put(0.1, 0.2, 0.3);
    fake_->buttons = 5;
    FakeInverse3 service(*fake_, newer);
    {
      const auto device = open_inverse3(inverse3_address(service.port()), "");
      EXPECT_EQ(device->name(), "Inverse3 049D, left-handed");
      const Sample s = sampled(*device);
      expect_near(s.reading.position, {0.1, 0.2, 0.3});
      expect_near(s.reading.orientation, {0, 0.6, 0, 0.8});
      EXPECT_EQ(s.reading.buttons, 5u);
      device->command({{1, 2, 3}, {}, 0});
      sampled(*device);
      expect_near(std::array{fake_->force[0].load(), fake_->force[1].load(), fake_->force[2].load()}, {1, 2, 3});
    }
    EXPECT_THROW(open_inverse3(inverse3_address(service.port()), "0000"), std::runtime_error);
  }
  EXPECT_THROW(open_inverse3(inverse3_address("1"), ""), MissingLibrary);
  EXPECT_THROW(inverse3_address("nowhere"), std::invalid_argument);
}

TEST(DeviceMessages, WhatIsNoStateGivesNothing) {
  for (const char* text : {"", "{", "[]", "7", "null"}) EXPECT_FALSE(parse_inverse3(text)) << text;
  for (const char* text :
       {"{}", R"({"inverse3": 3})", R"({"inverse3": [3]})", R"({"inverse3": [{"device_id": "A"}]})",
        R"({"inverse3": [{"device_id": "A", "state": {"cursor_position": {"x": 1, "y": "2", "z": 3}}}]})",
        R"({"inverse3": [{"device_id": "A", "state": {"cursor_position": {"x": 1, "y": 2}}}]})"})
    EXPECT_TRUE(parse_inverse3(text) && parse_inverse3(text)->devices.empty()) << text;
  const auto wired = parse_inverse3(
      R"({"inverse3": [{"device_id": "A", "state": {"cursor_position": {"x": 1, "y": 2, "z": 3}},
          "status": {"calibrated": false, "ready": true, "power_supply": false}}],
          "verse_grip": [{"device_id": "B", "state": {"button": true, "orientation": {"x": 0, "y": 0, "z": 2, "w": 0}}}]})");
  ASSERT_TRUE(wired && wired->find("A"));
  EXPECT_EQ(wired->find("A")->buttons, 1u);
  EXPECT_FALSE(wired->find("A")->calibrated);
  EXPECT_FALSE(wired->find("A")->ready);
  expect_near(wired->find("A")->orientation, {0, 0, 1, 0});
}

TEST(DeviceList, SaysWhatIsMissingAndWhoHasIt) {
  const CommandResult result = run_haptic("device list --service 1");
  EXPECT_EQ(result.code, 0);
  for (const char* says : {"openhaptics: 3D Systems", "libHD.so: cannot open shared object file", "forcedimension.com",
                           "no Inverse service at 127.0.0.1:1", "limits     inverse3"})
    EXPECT_NE(result.output.find(says), std::string::npos) << says << "\n" << result.output;
}

TEST_F(DeviceUnits, ListNamesWhatIsConnected) {
  const CommandResult result =
      run_haptic(std::string("device list --library ") + fake_force_dimension + " --service 1 --json " + scratch_.file("list.json"));
  EXPECT_EQ(result.code, 0) << result.output;
  EXPECT_NE(result.output.find("connected  0: omega.6, serial number 1042, left-handed"), std::string::npos)
      << result.output;
  EXPECT_NE(result.output.find("has no function hdInitDevice"), std::string::npos) << result.output;
}

TEST(DeviceRun, UsageAndMissingThingsAreSaid) {
  CommandResult result = run_haptic("device run tuch");
  EXPECT_EQ(result.code, 2);
  EXPECT_NE(result.output.find("there are openhaptics, force-dimension, falcon, inverse3"), std::string::npos)
      << result.output;
  result = run_haptic("device run openhaptics --library /nowhere/libHD.so");
  EXPECT_EQ(result.code, 1);
  EXPECT_NE(result.output.find("get it: OpenHaptics"), std::string::npos) << result.output;
  result = run_haptic("device run openhaptics --limits nothing");
  EXPECT_EQ(result.code, 2) << result.output;
  EXPECT_EQ(run_haptic("device").code, 2);
}

}  // namespace
}  // namespace hapticd
