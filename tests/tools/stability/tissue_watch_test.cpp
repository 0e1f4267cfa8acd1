// What the watch says of a block cut in two, its upper half free.
#include "tools/stability/bench/tissue_watch.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

class CutBlock : public testing::Test {
 protected:
  CutBlock() {
    BodySettings b{"block", true, box_mesh(Vec3(0.01, 0.01, 0.01), 3, 3, 3), {5000, 0.4, 1000, 2, 0}, {},
                   0,       true};
    b.fixed_nodes = b.mesh.group("bottom")->nodes;
    bodies.emplace_back(std::move(b), 0.02, Vec3::Zero());
    scene.rate = 50;
    scene.alarm_distance = 1e-3;
    scene.gravity.setZero();
  }

  // The middle of three layers goes.
  void cut() {
    Body& body = bodies[0];
    std::vector<int> tets;
    for (int t = 0; t < body.model.tet_count(); ++t) {
      double z = 0;
      for (const int n : body.model.mesh.tets[t]) z += 0.25 * body.rest()[n].z();
      if (z > 0.01 / 3 && z < 0.02 / 3) tets.push_back(t);
    }
    take_out(body, tets);
    body.corrected.force.setZero(3 * body.model.node_count());
  }
  void throw_upper(double speed) {
    for (std::size_t n = 0; n < bodies[0].rest().size(); ++n)
      if (bodies[0].rest()[n].z() > 0.006) bodies[0].state.v[n] = Vec3(speed, 0, 0);
  }

  Scene scene;
  Bodies bodies;
};

TEST_F(CutBlock, EnergyOfAFreePieceByHand) {
  TissueWatch watch(scene, bodies, 0.01);
  throw_upper(0.1);
  EXPECT_EQ(watch.look(bodies).free_energy, 0) << "it is held";
  cut();
  const double E = 0.5 * 1000 * 1e-6 / 3 * 0.1 * 0.1;  // a third of the block
  EXPECT_NEAR(watch.look(bodies).free_energy, E, 1e-9 * E);
  throw_upper(0.11);
  EXPECT_NEAR(watch.look(bodies).made, 0.21 * E, 1e-9 * E);
  throw_upper(0.05);
  EXPECT_EQ(watch.look(bodies).made, 0);
  // Pressed, it may have more, and counts from there.
  throw_upper(0.2);
  bodies[0].corrected.force[bodies[0].corrected.force.size() - 1] = 1e-3;
  EXPECT_EQ(watch.look(bodies).made, 0);
  bodies[0].corrected.force.setZero();
  EXPECT_EQ(watch.look(bodies).made, 0);
  throw_upper(0.3);
  EXPECT_NEAR(watch.look(bodies).made, 5 * E, 1e-9 * E);
}

// Of the whole, held block: thrown it has gained; with the work that was done on it, it has not.
TEST_F(CutBlock, EnergyGainedInAStepByHand) {
  TissueWatch watch(scene, bodies, 0.01);
  EXPECT_EQ(watch.look(bodies).gained, 0) << "nothing is known of before";
  Body& body = bodies[0];
  body.corrected.force.setZero(3 * body.model.node_count());
  std::size_t n = 0;
  while (body.rest()[n].z() < 0.009) ++n;
  const double m = body.state.mass[n];
  body.state.v[n] = Vec3(0.1, 0, 0);
  EXPECT_NEAR(watch.look(bodies).gained, 0.5 * m * 0.01, 1e-12 * m);
  EXPECT_EQ(watch.look(bodies).gained, 0);
  // Moved by 1 µm under 1 N: 1 µJ of work, far above what it stores and has of motion.
  body.state.x[n].x() += 1e-6;
  EXPECT_GT(watch.look(bodies).gained, 0);
  body.corrected.force[3 * static_cast<Eigen::Index>(n)] = 1;
  body.state.x[n].x() += 1e-6;
  body.state.v[n] = Vec3(0.2, 0, 0);
  EXPECT_EQ(watch.look(bodies).gained, 0);
}

// A step begins with what a cut of the mesh left: what that made is told apart from what the step gained.
TEST_F(CutBlock, EnergyGainedByACutOfTheMeshByHand) {
  TissueWatch watch(scene, bodies, 0.01);
  watch.begin_step(bodies);
  EXPECT_EQ(watch.look(bodies).split, 0);
  throw_upper(0.1);
  ++bodies[0].topology;
  watch.begin_step(bodies);
  double E = 0;
  for (std::size_t n = 0; n < bodies[0].rest().size(); ++n)
    E += 0.5 * bodies[0].state.mass[n] * bodies[0].state.v[n].squaredNorm();
  const TissueExtremes seen = watch.look(bodies);
  EXPECT_NEAR(seen.split, E, 1e-9 * E);
  EXPECT_EQ(seen.gained, 0);
  EXPECT_EQ(watch.look(bodies).split, 0) << "it is told once";
}

TEST_F(CutBlock, BoundsByHand) {
  const TissueWatch watch(scene, bodies, 0.01);
  EXPECT_NEAR(watch.bounds().farthest, 0.005 * std::sqrt(3.0) + 2 * 0.01 / 2 + 2e-3, 1e-12);
  EXPECT_NEAR(watch.bounds().fastest, 2 * 0.01 + 0.01 * 50, 1e-12);
}

}  // namespace
}  // namespace hapticd
