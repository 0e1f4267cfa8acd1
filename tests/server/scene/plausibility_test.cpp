// What is allowed and hardly meant is said.
#include "server/scene/plausibility.h"

#include <gtest/gtest.h>

#include "server/scene/scene_reader.h"

namespace hapticd {
namespace {

Scene cube() { return read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml"); }

bool is_said(const Scene& scene, const std::string& text) {
  for (const std::string& doubt : doubts(scene))
    if (doubt.find(text) != std::string::npos) return true;
  return false;
}

TEST(Plausibility, NothingIsSaidOfTheCube) { EXPECT_TRUE(doubts(cube()).empty()); }

TEST(Plausibility, ASizeInAnotherUnitIsSaidWithTheUnit) {
  for (const auto& [factor, unit] :
       {std::pair{1e3, "mesh_unit: mm"}, {1e6, "mesh_unit: um"}, {1e-3, "mesh_unit: km"}}) {
    Scene scene = cube();
    for (Vec3& x : scene.bodies[0].mesh.nodes) x *= factor;
    EXPECT_TRUE(is_said(scene, unit)) << unit;
  }
}

TEST(Plausibility, MoreNodesWithinReachThanAProblemHoldsAreSaid) {
  Scene scene = cube();
  scene.alarm_distance = 0.02;
  EXPECT_TRUE(is_said(scene, "a problem holds"));
}

}  // namespace
}  // namespace hapticd
