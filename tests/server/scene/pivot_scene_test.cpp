// Shipped scenes whose shafts pass through an incision.
#include <gtest/gtest.h>

#include <filesystem>

#include "server/record/trajectory_reader.h"
#include "server/scene/scene_reader.h"

namespace hapticd {
namespace {

const std::filesystem::path scenes = std::filesystem::path(SOURCE_DIR) / "config/scenes";

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
