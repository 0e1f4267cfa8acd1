#include "server/app/reload.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>

#include <gtest/gtest.h>

#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "server/scene/scene_reader.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

// The cube scene with a device file of its own, in a folder of its own.
struct ReloadedScene : testing::Test {
  fs::path folder = fs::temp_directory_path() / ("hapticd-reload-" + std::to_string(getpid()));
  fs::path scene = folder / "cube.yaml", device = folder / "touch.yaml";

  ReloadedScene() {
    fs::remove_all(folder);
    fs::copy(fs::path(SOURCE_DIR) / "config/scenes/cube", folder);
    fs::copy(fs::path(SOURCE_DIR) / "config/devices/touch.yaml", device);
    change(scene, "device: touch", "device: touch.yaml");
  }
  ~ReloadedScene() override { fs::remove_all(folder); }

  static void change(const fs::path& file, const std::string& from, const std::string& to) {
    std::string text = read_bytes(file);
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    std::ofstream(file) << text.replace(at, from.size(), to);
  }
  Reloader reloader() const { return Reloader(read_scene(scene), "", {}); }
};

using Lines = std::vector<std::string>;

TEST_F(ReloadedScene, UnchangedNothingIsTaken) {
  const Reload r = reloader().read();
  EXPECT_TRUE(r.taken.empty() && r.clamped.empty() && r.not_taken.empty() && r.anew.empty() && !r.scene);
  ASSERT_EQ(r.tunings.size(), 1u);
  EXPECT_EQ(r.tunings[0], tuning_of(read_scene(scene).first().device));
}

TEST_F(ReloadedScene, LimitsScalesAndLoggingAreTakenTheRestIsAnew) {
  Reloader reloader = this->reloader();
  change(device, "max_force: 3.3", "max_force: 2");
  change(scene, "force_scale: 1", "force_scale: 0.5");
  change(scene, "rate: 50", "rate: 100");
  change(scene, "young: 5.0e3", "young: 6.0e3");
  std::ofstream(scene, std::ios::app) << "\nlogging: {level: debug}\n";
  const Reload r = reloader.read();
  EXPECT_EQ(r.taken, (Lines{"logging.level info → debug", "device 0: max_force 3.3 → 2",
                            "device 0: force_scale 1 → 0.5"}));
  EXPECT_EQ(r.anew, (Lines{"bodies[0].material.young", "simulation.rate"}));
  ASSERT_TRUE(r.scene);
  EXPECT_EQ(r.scene->bodies[0].material.young, 6000);
  EXPECT_TRUE(r.not_taken.empty());
  EXPECT_TRUE(r.clamped.empty());
  EXPECT_EQ(r.tunings[0].max_force, 2);
  EXPECT_EQ(r.tunings[0].force_scale, 0.5);
  EXPECT_EQ(r.log_level, "debug");
  // Again: taken is taken, what was not begun anew still differs.
  const Reload again = reloader.read();
  EXPECT_TRUE(again.taken.empty());
  EXPECT_EQ(again.anew.size(), 2u);
  reloader.begun_anew();
  EXPECT_TRUE(reloader.read().anew.empty());
}

TEST_F(ReloadedScene, WhatOnlyAStartCanMakeIsNotTaken) {
  Reloader reloader = this->reloader();
  std::ofstream(scene, std::ios::app) << "\nros2: true\nhaptic: {mode: event}\n";
  const Reload r = reloader.read();
  EXPECT_EQ(r.not_taken, (Lines{"haptic.mode (restart for it)", "ros2 (restart for it)"}));
  EXPECT_FALSE(r.scene);
}

TEST_F(ReloadedScene, NothingGoesBeyondWhatTheDeviceStartedWith) {
  Reloader reloader = this->reloader();
  change(device, "max_force: 3.3", "max_force: 30");
  change(scene, "force_scale: 1", "force_scale: 4");  // coupling 400 N/m, and the device displays 400
  const Reload r = reloader.read();
  EXPECT_TRUE(r.taken.empty());
  EXPECT_EQ(r.clamped, (Lines{"device 0: max_force 30 is beyond what the device started with: 3.3",
                              "device 0: force_scale 4 is beyond what the device displays stably: 1"}));
  EXPECT_EQ(r.tunings[0],
            tuning_of(read_scene(fs::path(SOURCE_DIR) / "config/scenes/cube/cube.yaml").first().device));
}

TEST_F(ReloadedScene, AnotherDeviceIsNotTakenNorItsLimits) {
  Reloader reloader = this->reloader();
  change(scene, "device: touch.yaml", "device: premium_1_5");
  const Reload r = reloader.read();
  EXPECT_EQ(r.not_taken, (Lines{"device (restart for it)"}));
  EXPECT_EQ(r.tunings[0].max_force, 3.3);
}

TEST_F(ReloadedScene, ANewerMeshIsNamed) {
  Reloader reloader = this->reloader();
  fs::last_write_time(folder / "cube.msh",
                      fs::last_write_time(folder / "cube.msh") + std::chrono::seconds(5));
  const Reload r = reloader.read();
  ASSERT_EQ(r.anew.size(), 1u);
  EXPECT_NE(r.anew[0].find("cube.msh: a newer mesh"), std::string::npos);
  EXPECT_TRUE(r.scene);
}

TEST_F(ReloadedScene, AFaultIsNamedByFileLineAndKey) {
  Reloader reloader = this->reloader();
  change(scene, "force_scale: 1", "force_scale: plenty");
  try {
    reloader.read();
    FAIL();
  } catch (const InputError& e) {
    EXPECT_EQ(e.key(), "mapping.force_scale");
    EXPECT_GT(e.line(), 0);
  }
}

// The same cube under two hands: the first with the folder's own device file, the second with the shipped
// one.
struct ReloadedHands : ReloadedScene {
  ReloadedHands() { write("left", "right"); }

  static std::string entry(const std::string& name) {
    const bool left = name == "left";
    return "  - {name: " + name + ", tip: t, primitives: [{name: t, shape: sphere, radius: 3.0e-3}], " +
           "coupling: {stiffness: 400, rotational_stiffness: 0.04, damping_time: 2.0e-3}, device: " +
           (left ? "touch.yaml, id: 3" : "touch, id: 5") +
           ", mapping: {position_scale: 1, force_scale: " + (left ? "1" : "0.75") + "}}\n";
  }
  void write(const std::string& first, const std::string& second) const {
    std::string text = read_bytes(fs::path(SOURCE_DIR) / "config/scenes/cube/cube.yaml");
    text.resize(text.find("instrument:"));
    std::ofstream(scene) << text << "instruments:\n" << entry(first) << entry(second);
  }
};

TEST_F(ReloadedHands, EachDeviceIsTunedByItsId) {
  Reloader reloader = this->reloader();
  EXPECT_TRUE(reloader.read().taken.empty());
  change(device, "max_force: 3.3", "max_force: 2");
  change(scene, "force_scale: 0.75", "force_scale: 0.5");
  const Reload r = reloader.read();
  EXPECT_EQ(r.taken, (Lines{"device 3: max_force 3.3 → 2", "device 5: force_scale 0.75 → 0.5"}));
  EXPECT_TRUE(r.clamped.empty() && r.not_taken.empty());
  ASSERT_EQ(r.tunings.size(), 2u);
  EXPECT_EQ(r.tunings[0].max_force, 2);
  EXPECT_EQ(r.tunings[0].force_scale, 1);
  EXPECT_EQ(r.tunings[1].max_force, 3.3);
  EXPECT_EQ(r.tunings[1].force_scale, 0.5);
}

TEST_F(ReloadedHands, ADeviceIsFoundWhereverItsInstrumentStands) {
  Reloader reloader = this->reloader();
  write("right", "left");
  change(device, "max_force: 3.3", "max_force: 2");
  change(scene, "force_scale: 0.75", "force_scale: 0.5");
  const Reload r = reloader.read();
  EXPECT_EQ(r.taken, (Lines{"device 3: max_force 3.3 → 2", "device 5: force_scale 0.75 → 0.5"}));
  EXPECT_EQ(r.tunings[0].max_force, 2);  // still the first device of the start
  EXPECT_EQ(r.tunings[1].force_scale, 0.5);
  EXPECT_NE(std::find(r.not_taken.begin(), r.not_taken.end(), "instruments[0].name (restart for it)"),
            r.not_taken.end());
}

TEST_F(ReloadedHands, ADeviceThatIsGoneStaysAsItIs) {
  Reloader reloader = this->reloader();
  change(scene, "id: 5", "id: 6");
  change(scene, "force_scale: 0.75", "force_scale: 0.5");
  const Reload r = reloader.read();
  EXPECT_TRUE(r.taken.empty());
  EXPECT_EQ(r.not_taken, (Lines{"instruments[1].id (restart for it)"}));
  EXPECT_EQ(r.tunings[1].force_scale, 0.75);
}

}  // namespace
}  // namespace hapticd
