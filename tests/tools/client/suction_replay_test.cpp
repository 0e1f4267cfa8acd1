// Scenes with a port and with a pivot, replayed as they ship.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>

#include "server/record/trajectory_reader.h"
#include "server/scene/scene_reader.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

const std::filesystem::path scenes = std::filesystem::path(SOURCE_DIR) / "config/scenes";

double weight_of(const SceneBody& body, double g) {
  double volume = 0;
  for (const Tet& t : body.mesh.tets) {
    const auto& x = body.mesh.nodes;
    volume += (x[t[1]] - x[t[0]]).cross(x[t[2]] - x[t[0]]).dot(x[t[3]] - x[t[0]]) / 6;
  }
  return g * body.material.density * volume;
}

// z of the force in the mean from … to [s].
double mean_force_z(const std::string& csv, double from, double to) {
  std::istringstream lines(csv);
  std::string line;
  std::getline(lines, line);
  const auto column = [](const std::string& row, int k) {
    std::size_t at = 0;
    for (; k > 0; --k) at = row.find(',', at) + 1;
    return row.substr(at, row.find(',', at) - at);
  };
  int t = -1, fz = -1;
  for (int k = 0; t < 0 || fz < 0; ++k) {
    if (k > 40) return 1e300;
    const std::string name = column(line, k);
    if (name == "t") t = k;
    if (name == "fz") fz = k;
  }
  double sum = 0;
  int n = 0;
  while (std::getline(lines, line)) {
    const double now = std::stod(column(line, t));
    if (now >= from && now < to) sum += std::stod(column(line, fz)), ++n;
  }
  return sum / n;
}

// While it hangs the hand carries the piece's weight; when the pedal is let go nothing is left of it.
TEST(SuctionScene, APieceIsLiftedCarriedAndLetFall) {
  const ScratchDirectory scratch;
  const std::string file = (scenes / "fragment/held.yaml").string();
  const CommandResult result =
      run_haptic("replay --offline --scene " + file + " --forces " + scratch.file("forces.csv"));
  ASSERT_EQ(result.code, 0) << result.output;
  const Scene scene = read_scene(file);
  const double weight = scene.first().device.force_scale * weight_of(scene.bodies[0], -scene.gravity.z());
  const std::string forces = read_bytes(scratch.file("forces.csv"));
  EXPECT_NEAR(mean_force_z(forces, 4.6, 5.4), -weight, 0.1 * weight);
  EXPECT_NEAR(mean_force_z(forces, 6.6, 6.9), -weight, 0.1 * weight);
  EXPECT_NEAR(mean_force_z(forces, 8.2, 8.5), 0, 0.01 * weight);
}

// In every millisecond of the shipped motions, as the device's map has it.
TEST(PivotScene, EveryShaftPassesThroughItsIncision) {
  for (const char* name : {"cataract/cataract.yaml", "two_hands/two_hands.yaml"}) {
    const Scene scene = read_scene(scenes / name);
    for (const SceneInstrument& held : scene.instruments) {
      ASSERT_TRUE(held.device.pivot && held.trajectory) << held.name;
      const Pivot& pivot = *held.device.pivot;
      const Trajectory motion = read_trajectory(*held.trajectory, LengthUnit::metre);
      for (double t = motion.begin(); t < motion.end(); t += 1e-3) {
        const Pose X = to_scene(held.device, sample_at(motion, t));
        const Vec3 shaft = X.q * Vec3::UnitZ(), v = pivot.point - X.p;
        ASSERT_LT((v - shaft * shaft.dot(v)).norm(), 50e-6) << held.name << ", " << t << " s";
      }
    }
  }
}

}  // namespace
}  // namespace hapticd
