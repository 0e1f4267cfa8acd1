// Method zone in tissue that turns: definite always, and exact where a piece turns as a whole.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <numeric>

#include "tests/physics/compliance/zone/zone_bench.h"

namespace hapticd {
namespace {

using namespace zone_bench;

// S ≥ M(now) in the sense of quadratic forms: so C_pp is definite, and bounded by the mass alone.
TEST(ZoneCompliance, IsDefiniteHoweverEverythingTurned) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  TissueState state = rest_state(model);
  ComplianceOptions options;
  options.usable_error = 1e30;
  const auto compliance = zone_method(model, zone, options);
  compliance->update(state);
  std::mt19937 random(10);
  std::uniform_real_distribution<double> angle(-3.1, 3.1);
  const std::vector<int> tets = tets_where(model, zone, Where::inside);
  for (int trial = 0; trial < 40; ++trial) {
    // Rotations of each element at random are worse than any shape; then a crushed box.
    if (trial < 20) {
      for (Mat3& R : state.rotation)
        R = Eigen::AngleAxisd(angle(random), random_vector(random, 1.0).normalized()).toRotationMatrix();
    } else {
      for (int n = 0; n < model.node_count(); ++n)
        if (!model.fixed[n])
          state.x[n] = model.mesh.nodes[n].cwiseProduct(Vec3(1, 1, 0.2)) + random_vector(random, 1e-3);
      update_rotations(model, state);
    }
    if (trial % 3 == 0) remove(model, state, *compliance, {tets[trial / 3]});
    compliance->update(state);
    EXPECT_LE(compliance->report().reference_age, trial + 2);
    std::vector<int> live;
    for (const int n : zone)
      if (state.live_tets_of_node[n] > 0) live.push_back(n);
    MatX block(3 * live.size(), 3 * live.size());
    compliance->patch(live, block);
    const Eigen::SelfAdjointEigenSolver<MatX> eigen(block, Eigen::EigenvaluesOnly);
    double least_mass = 1;
    for (const int n : live) least_mass = std::min(least_mass, state.mass[n]);
    const double bound = 1 / ((1 / (h * h) + model.material.rayleigh_mass / h) * least_mass);
    EXPECT_GT(eigen.eigenvalues().minCoeff(), 0);
    EXPECT_LE(eigen.eigenvalues().maxCoeff(), bound * (1 + 1e-9));
    EXPECT_EQ(compliance->report().reference_age, trial + 2) << "a new reference factor was needed";
  }
}

// A rigid turn of the whole floating body changes nothing but the axes: the warped reference factor is exact.
TEST(ZoneCompliance, ARigidTurnNeedsNoNewReference) {
  const TissueModel model = box(3, 1, false);
  const std::vector<int> zone = oracle::nearest(model, tip, 20);
  TissueState state = deformed(model, 12, 1e-4);
  const Mat3 R = Eigen::AngleAxisd(1.2, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  TissueState turned = state;
  for (Vec3& x : turned.x) x = R * x;
  update_rotations(model, turned);
  for (const Warping warping : {Warping::piece, Warping::node}) {
    ComplianceOptions options;
    options.warping = warping;
    const auto compliance = zone_method(model, zone, options);
    compliance->update(state);
    compliance->update(turned);
    const Errors errors = errors_of(model, turned, *compliance, zone);
    EXPECT_LT(errors.apply, 1e-9);
    EXPECT_LT(errors.patch, 1e-9);
    EXPECT_EQ(compliance->report().health, ComplianceHealth::good);
    EXPECT_NEAR(compliance->report().rotation_since_reference, warping == Warping::node ? 1.2 : 0.0, 1e-6);
    EXPECT_EQ(compliance->report().wants_reference, warping == Warping::node);
  }
}

// Two pieces that turn differently, each by its own mean: exact, where one turn for both is not.
TEST(ZoneCompliance, EachPieceTurnsByItself) {
  const TissueModel model = box(4, 1, false);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  TissueState state = deformed(model, 12, 1e-4);
  std::vector<int> layer(96);
  std::iota(layer.begin(), layer.end(), 2 * 96);
  remove_tets(model, state, layer);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  const Mat3 R = Eigen::AngleAxisd(0.7, Vec3(3, -1, 1).normalized()).toRotationMatrix();
  for (int n = 0; n < model.node_count(); ++n)
    if (model.mesh.nodes[n].z() > 0.6 * oracle::size.z()) state.x[n] = R * state.x[n];
  update_rotations(model, state);
  compliance->update(state);
  expect_exact(model, state, *compliance, zone, 1e-9);
}

}  // namespace
}  // namespace hapticd
