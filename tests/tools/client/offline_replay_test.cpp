// Offline replays of several instruments: a motion and a file of forces each.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "server/files/paths.h"
#include "tests/tools/run_command.h"
#include "tools/client/replay_offline.h"

namespace hapticd {
namespace {

constexpr const char* cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";

class SeveralInstrumentsOffline : public testing::Test {
 protected:
  const ScratchDirectory scratch;

  // Down onto the cube at x, 1 mm deep.
  std::string motion(const std::string& name, double x) const {
    std::string csv = "t,px,py,pz,qx,qy,qz,qw\n";
    for (int i = 0; i <= 15; ++i)
      csv += std::to_string(0.01 * i) + "," + std::to_string(x) + ",0," +
             std::to_string(0.0235 - 0.0015 * std::min(1.0, i / 8.0)) + ",0,0,0,1\n";
    return scratch.file(name, csv);
  }

  // The cube under two such balls.
  std::string two_balls() const {
    const std::string ball =
        ", tip: tip, primitives: [{name: tip, shape: sphere, radius: 3.0e-3}], coupling: "
        "{stiffness: 400, rotational_stiffness: 0.04, damping_time: 2.0e-3}, device: touch, "
        "mapping: {position_scale: 1, force_scale: 1}, id: ";
    const std::string folder = SOURCE_DIR "/config/scenes/cube/";
    return scratch.file(
        "two.yaml",
        "scene: two\nsimulation: {rate: 50, alarm_distance: 5.0e-3, sample_spacing: 1.0e-3}\n"
        "bodies:\n  - {name: cube, kind: deformable, mesh: " +
            folder +
            "cube.msh, fixed: bottom, "
            "material: {young: 5.0e3, poisson: 0.45, density: 1000, rayleigh: {mass: 2.0, stiffness: "
            "2.0e-3}}}\ninstruments:\n  - {name: left" +
            ball + "0}\n  - {name: right" + ball + "7}\n");
  }
};

TEST_F(SeveralInstrumentsOffline, EachInstrumentHasItsMotionItsForcesAndItsFigures) {
  const std::string scene = two_balls(), a = motion("a.csv", -0.004), b = motion("b.csv", 0.004);
  const CommandResult result =
      run_haptic("replay " + a + " " + b + " --offline --scene " + scene + " --forces " +
                 scratch.file("forces.csv") + " --json " + scratch.file("figures.json"));
  ASSERT_EQ(result.code, 0) << result.output;
  const auto figures = nlohmann::json::parse(std::ifstream(scratch.file("figures.json")));
  ASSERT_EQ(figures["devices"].size(), 2u);
  EXPECT_EQ(figures["devices"][0]["instrument"], "left");
  EXPECT_EQ(figures["devices"][1]["instrument"], "right");
  EXPECT_EQ(figures["devices"][1]["device_id"], 7);
  EXPECT_EQ(figures["devices"][1]["file"], b);
  for (const auto& device : figures["devices"]) EXPECT_GT(device["force_peak_n"].get<double>(), 1e-3);
  const std::string left = read_bytes(scratch.file("forces.csv")),
                    right = read_bytes(scratch.file("forces.right.csv"));
  EXPECT_EQ(std::count(left.begin(), left.end(), '\n'), 152);
  EXPECT_EQ(std::count(right.begin(), right.end(), '\n'), 152);
  EXPECT_NE(left, right);
}

TEST_F(SeveralInstrumentsOffline, AForeignFileUnderAnInstrumentsNameIsNotWrittenOver) {
  const std::string foreign = scratch.file("forces.right.csv", "mine\n");
  const std::string command = "replay " + motion("a.csv", -0.004) + " " + motion("b.csv", 0.004) +
                              " --offline --scene " + two_balls() + " --forces " + scratch.file("forces.csv");
  EXPECT_EQ(run_haptic(command).code, 2);
  EXPECT_EQ(read_bytes(foreign), "mine\n");
}

TEST_F(SeveralInstrumentsOffline, MoreMotionsThanInstrumentsAreRefused) {
  const std::string a = motion("a.csv", -0.004);
  const CommandResult result = run_haptic("replay " + a + " " + a + " --offline --scene " + cube);
  EXPECT_EQ(result.code, 2) << result.output;
  EXPECT_NE(result.output.find("2 recordings for 1 instruments"), std::string::npos) << result.output;
}

// Without a FILE the scene's own trajectory is played, to the same forces.
TEST_F(SeveralInstrumentsOffline, WithoutFilesTheScenesOwnMotionsArePlayed) {
  const std::string rest =
      std::string(" --offline --scene ") + cube + " --speed 20 --allow-refused --forces ";
  ASSERT_EQ(run_haptic("replay" + rest + scratch.file("own.csv")).code, 0);
  ASSERT_EQ(
      run_haptic("replay " SOURCE_DIR "/config/scenes/cube/press.csv" + rest + scratch.file("named.csv"))
          .code,
      0);
  EXPECT_EQ(read_bytes(scratch.file("own.csv")), read_bytes(scratch.file("named.csv")));
  EXPECT_EQ(run_haptic("replay --offline --scene " + two_balls()).code, 2) << "it has none";
}

TEST(FileOfInstrument, CarriesItsName) {
  Scene scene;
  scene.instruments.resize(2);
  scene.instruments[1].name = "chopper";
  EXPECT_EQ(file_of_instrument("out/F.csv", scene, 0), "out/F.csv");
  EXPECT_EQ(file_of_instrument("out/F.csv", scene, 1), "out/F.chopper.csv");
  EXPECT_EQ(file_of_instrument("out.d/F", scene, 1), "out.d/F.chopper");
  EXPECT_EQ(file_of_instrument("", scene, 1), "");
}

}  // namespace
}  // namespace hapticd
