#include "physics/tissue/configurational_force.h"

#include <random>

#include <gtest/gtest.h>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr Material gel{3000, 0.4, 1000, 0, 0};

double energy_with(TetMesh mesh, int node, int axis, double by, const std::vector<Vec3>& x) {
  mesh.nodes[node][axis] += by;
  const TissueModel model = make_tissue_model(std::move(mesh), gel, {}, Vec3::Zero());
  TissueState state = rest_state(model);
  state.x = x;
  update_rotations(model, state);
  return elastic_energy(model, state);
}

// −∂E/∂X at fixed x, by central differences of the rest shape.
TEST(ConfigurationalForce, IsTheFallOfEnergyAsTheRestShapeMoves) {
  const TetMesh mesh = box_mesh(Vec3(2e-3, 2e-3, 2e-3), 2, 2, 2);
  const TissueModel model = make_tissue_model(mesh, gel, {}, Vec3::Zero());
  TissueState state = rest_state(model);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> by(-2e-4, 2e-4);
  for (Vec3& x : state.x)
    x = Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()) * x + Vec3(by(random), by(random), by(random));
  update_rotations(model, state);
  const VecX G = configurational_forces(model, state).at_rest;
  const double d = 1e-8;
  for (const int node : {0, 4, 13, 26})
    for (int axis = 0; axis < 3; ++axis) {
      const double fall =
          (energy_with(mesh, node, axis, -d, state.x) - energy_with(mesh, node, axis, d, state.x)) / (2 * d);
      EXPECT_NEAR(G[3 * node + axis], fall, 1e-6 * G.lpNorm<Eigen::Infinity>());
    }
}

// In equilibrium Q counts for nothing; a turn of the whole body by Q turns nothing of G.
TEST(ConfigurationalForce, OfForcesLeftOverTheTurnedPartIsNotCounted) {
  const TissueModel model = make_tissue_model(box_mesh(Vec3(2e-3, 2e-3, 2e-3), 2, 2, 2), gel, {}, Vec3::Zero());
  TissueState state = rest_state(model);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> by(-1e-7, 1e-7);
  for (Vec3& x : state.x) x += Vec3(by(random), by(random), by(random));
  update_rotations(model, state);
  const ConfigurationalForces straight = configurational_forces(model, state);
  const Mat3 Q = Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  for (Vec3& x : state.x) x = Q * x;
  update_rotations(model, state);
  const ConfigurationalForces turned = configurational_forces(model, state);
  VecX f(3 * model.node_count());
  internal_forces(model, state, f);
  EXPECT_LT((f + turned.at_place).norm(), 1e-9 * f.norm());
  for (int n = 0; n < model.node_count(); ++n) {
    const Vec3 G = straight.at(n, Mat3::Identity());
    EXPECT_LT((turned.at(n, Q) - G).norm(), 1e-6 * G.norm());
    EXPECT_LT(G.norm(), 1e-3 * straight.at_rest.segment<3>(3 * n).norm()) << "a strain smaller";
  }
}

// The same strain everywhere: nothing inside drives anything.
TEST(ConfigurationalForce, IsZeroInsideAHomogeneousStrain) {
  const TissueModel model =
      make_tissue_model(box_mesh(Vec3(2e-3, 2e-3, 2e-3), 2, 2, 2), gel, {}, Vec3::Zero());
  TissueState state = rest_state(model);
  const Mat3 A = (Mat3() << 1.2, 0.1, 0, 0.1, 0.9, 0.05, 0, 0.05, 1.1).finished();
  for (Vec3& x : state.x) x = A * x;
  update_rotations(model, state);
  const VecX G = configurational_forces(model, state).at_rest;
  EXPECT_LT(G.segment<3>(3 * 13).norm(), 1e-12 * G.norm());
}

}  // namespace
}  // namespace hapticd
