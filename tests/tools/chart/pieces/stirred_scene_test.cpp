// The chart's judge of overlap by hand, and that stirring ends each joint solve.
#include "tools/chart/pieces/stirred_scene.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "server/scene/scene_reader.h"
#include "tests/support/bodies.h"
#include "tools/chart/pieces/piece_overlap.h"

namespace hapticd {
namespace {

TEST(PieceOverlap, IsTheDepthOfTheDeepestNode) {
  const Material soft{5000, 0.4, 1000, 0, 2e-3};
  Bodies bodies;
  bodies.emplace_back(slab("floor", Vec3(0.02, 0.02, 4e-3), {5, 5, 2}), 0.02, Vec3::Zero());
  bodies.emplace_back(block("block", Vec3(6e-3, 6e-3, 6e-3), {2, 2, 2}, soft,
                            {Vec3(7.1e-3, 7.2e-3, 4e-3 - 3e-5), Quat::Identity()}),
                      0.02, Vec3::Zero());
  const std::vector<ContactPair> pairs = {{1, 0, 0}};
  PieceOverlap o = find_overlap(bodies, pairs);
  EXPECT_NEAR(o.depth, 3e-5, 1e-12);
  EXPECT_EQ(o.nodes, 9 + 4);  // … and the floor's at 8 and 12 mm
  for (Vec3& x : bodies[1].state.x) x.z() += 4e-5;
  o = find_overlap(bodies, pairs);
  EXPECT_EQ(o.depth, 0);
  EXPECT_EQ(o.nodes, 0);
}

TEST(ChartPieces, EveryJointSolveOfTheStirredFragmentEnds) {
  const Scene scene = read_scene(std::filesystem::path(SOURCE_DIR) / "config/scenes/fragment/fragment.yaml");
  StirSettings settings;
  settings.steps = 150;
  const StirFigures f = stir(scene, settings, {});
  std::printf("  %d of %d steps with contacts of bodies, %d touches, overlap %.2f um, third law %.1e\n",
              f.joint, f.steps, f.touches, 1e6 * f.overlap, f.third_law);
  EXPECT_EQ(f.steps, 150);
  EXPECT_GT(f.joint, 50);
  EXPECT_EQ(f.capped, 0);
  EXPECT_LT(f.third_law, 1e-9);
  EXPECT_LE(f.overlap, 20e-6);
}

// Corners over edges, and nodes between three pieces: without them some 200 um deep, and through.
TEST(ChartPieces, StirredQuadrantsStayApart) {
  const Scene scene =
      read_scene(std::filesystem::path(SOURCE_DIR) / "config/scenes/quadrants/quadrants.yaml");
  StirSettings settings;
  settings.steps = 110;
  const StirFigures f = stir(scene, settings, {});
  std::printf("  %d of %d steps with contacts of bodies, %d touches, overlap %.2f um\n", f.joint, f.steps,
              f.touches, 1e6 * f.overlap);
  EXPECT_GT(f.joint, 50);
  EXPECT_EQ(f.capped, 0);
  EXPECT_EQ(f.tunnelled, 0);
  EXPECT_LE(f.overlap, 20e-6);
}

}  // namespace
}  // namespace hapticd
