// Solves with method zone's factor: two halves are the whole, and what refinement would change of them.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numbers>
#include <stdexcept>

#include "tests/physics/compliance/zone/zone_bench.h"

namespace hapticd {
namespace {

using namespace zone_bench;

// start_solve(b) is C b on zone and halo, where the forward half reaches, and finish_solve(f) is C (b + f)
// for f there; carried terms and turned tissue included. An update ends what was started.
TEST(ZoneCompliance, HalvesAreTheWhole) {
  const TissueModel model = box(4);
  const std::vector<int> near = oracle::nearest(model, tip, 45);
  const std::vector<int> zone(near.begin(), near.begin() + 30), halo(near.begin() + 30, near.end());
  for (const bool with_halo : {false, true}) {
    TissueState state = deformed(model, 5);
    const auto compliance = zone_method(model, zone);
    if (with_halo) compliance->move_halo(halo);
    compliance->update(state);
    const std::vector<int> gone = tets_where(model, zone, Where::across);
    remove(model, state, *compliance, {gone[0], gone[1]});
    for (Vec3& x : state.x) x = Eigen::AngleAxisd(0.3, Vec3::UnitX()) * x;
    update_rotations(model, state);
    compliance->update(state);
    EXPECT_TRUE(compliance->forward_covers(with_halo ? near : zone));

    const VecX b = VecX::Random(3 * model.node_count());
    VecX f = VecX::Zero(b.size()), y(b.size()), whole(b.size());
    for (const int n : {zone[0], zone[7], zone[29]}) f.segment<3>(3 * n) = Vec3(1, -2, 3);
    if (with_halo) f.segment<3>(3 * halo[4]) = Vec3(-2, 0, 1);
    compliance->apply(b, whole);
    ASSERT_EQ(compliance->start_solve(b, y), Solved::forward);
    for (int n = 0; n < model.node_count(); ++n) {
      const bool known = compliance->forward_covers(std::span(&n, 1));
      const Vec3 expected = known ? Vec3(whole.segment<3>(3 * n)) : Vec3(0, 0, 0);
      EXPECT_LT((y.segment<3>(3 * n) - expected).norm(), 1e-12 * whole.norm());
    }
    // What is asked in between does not disturb it.
    MatX block(9, 9);
    compliance->patch(std::vector<int>{zone[1], zone[2], near.back()}, block);
    VecX in_zone = VecX::Zero(b.size());
    for (const int n : {zone[0], zone[7], zone[29]}) in_zone.segment<3>(3 * n) = f.segment<3>(3 * n);
    VecX there(b.size());
    compliance->apply(in_zone, whole);
    compliance->apply_in_zone(in_zone, there);
    for (const int n : zone)
      EXPECT_LT((there.segment<3>(3 * n) - whole.segment<3>(3 * n)).norm(), 1e-12 * whole.norm());
    compliance->apply(b + f, whole);
    compliance->finish_solve(f, y);
    EXPECT_LT((y - whole).norm(), 1e-12 * whole.norm());
    EXPECT_THROW(compliance->finish_solve(f, y), std::runtime_error);
    ASSERT_EQ(compliance->start_solve(b, y), Solved::forward);
    compliance->update(state);
    EXPECT_THROW(compliance->finish_solve(f, y), std::runtime_error);
  }
}

// ‖C A y − y‖∞/‖y‖∞ against dense matrices: nothing at the reference factor, and by how much the reference
// factor is off later; and where elements outside the zone have turned by a right angle, from 1 on, for some
// y: those errors grow.
TEST(ZoneCompliance, DisagreementIsWhatRefinementWouldChange) {
  const TissueModel model = box(3);
  const std::vector<int> zone = oracle::nearest(model, tip, 12);
  const auto compliance = zone_method(model, zone);
  TissueState state = deformed(model, 3);
  compliance->update(state);
  std::mt19937 random(5);
  VecX y = VecX::Zero(3 * model.node_count());
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) y.segment<3>(3 * n) = random_vector(random, 1e-3);
  EXPECT_LT(compliance->disagreement(state, y), 1e-10);

  state = deformed(model, 4, 8e-4);
  compliance->update(state);
  const MatX A = MatX(assemble_system_matrix(model, state, h));
  VecX change = A * y;
  compliance->apply(change, change);
  change -= y;
  EXPECT_NEAR(compliance->disagreement(state, y),
              change.lpNorm<Eigen::Infinity>() / y.lpNorm<Eigen::Infinity>(), 1e-9);

  for (int t = 0; t < model.tet_count(); ++t)
    if (oracle::where(model, zone, t) == Where::outside)
      state.rotation[t] = state.rotation[t] * Eigen::AngleAxisd(std::numbers::pi / 2, Vec3::UnitX());
  compliance->update(state);
  double grows = 0;  // by power iteration
  for (int k = 0; k < 30; ++k) {
    grows = compliance->disagreement(state, y);
    VecX next = MatX(assemble_system_matrix(model, state, h)) * y;
    compliance->apply(next, next);
    y -= next;
    y /= y.lpNorm<Eigen::Infinity>();
  }
  EXPECT_GT(grows, 1);
}

}  // namespace
}  // namespace hapticd
