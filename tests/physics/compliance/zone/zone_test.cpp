// Method zone against a dense inverse: exact while nothing has moved since the reference factor, definite
// always.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <numbers>
#include <stdexcept>
#include <thread>

#include "physics/compliance/reference/warp_rotation.h"
#include "tests/physics/compliance/oracle.h"

namespace hapticd {
namespace {

using oracle::box;
using oracle::deformed;
using oracle::h;
using oracle::Where;

const Vec3 tip(4.5e-3, 4e-3, 6e-3);

std::unique_ptr<Compliance> zone_method(const TissueModel& model, const std::vector<int>& zone,
                                        const ComplianceOptions& options = {}) {
  auto compliance = make_compliance(ComplianceMethod::zone, model, h, options);
  compliance->move_zone(zone);
  return compliance;
}

void remove(const TissueModel& model, TissueState& state, Compliance& compliance,
            const std::vector<int>& tets) {
  remove_tets(model, state, tets);
  compliance.remove(state, tets);
}

struct Errors {
  double apply, patch;
};
Errors errors_of(const TissueModel& model, const TissueState& state, Compliance& compliance,
                 const std::vector<int>& patch) {
  const MatX C = oracle::inverse(model, state);
  return {oracle::apply_error(compliance, C), oracle::patch_error(compliance, C, patch)};
}

void expect_exact(const TissueModel& model, const TissueState& state, Compliance& compliance,
                  const std::vector<int>& patch, double tolerance = 1e-10) {
  const Errors errors = errors_of(model, state, compliance, patch);
  EXPECT_LT(errors.apply, tolerance);
  EXPECT_LT(errors.patch, tolerance);
  EXPECT_EQ(compliance.report().health, ComplianceHealth::good);
  EXPECT_LT(compliance.report().residual, 1e-10);
}

std::vector<int> tets_where(const TissueModel& model, const std::vector<int>& zone, Where where) {
  std::vector<int> tets;
  for (int t = 0; t < model.tet_count(); ++t)
    if (oracle::where(model, zone, t) == where) tets.push_back(t);
  std::mt19937 random(17);
  std::shuffle(tets.begin(), tets.end(), random);
  return tets;
}

TEST(ZoneCompliance, IsExactAtItsBaseForAnyZone) {
  const TissueModel model = box(3);
  const TissueState state = deformed(model, 3);
  for (const int count : {0, 1, 7, 20, 47, 48}) {
    const std::vector<int> zone = oracle::nearest(model, tip, count);
    const auto compliance = zone_method(model, zone);
    compliance->update(state);
    EXPECT_TRUE(compliance->zone_covers(zone));
    expect_exact(model, state, *compliance, zone);
    // Nodes outside the zone are given too, mixed with fixed ones.
    expect_exact(model, state, *compliance, {5, 20, 33, 47, 48, 63});
    EXPECT_LT(compliance->report().rotation_since_reference, 1e-7);
  }
}

TEST(ZoneCompliance, RemovalAnywhereIsExactWhileNothingMoved) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  for (const Where where : {Where::inside, Where::across, Where::outside}) {
    TissueState state = deformed(model, 5);
    const auto compliance = zone_method(model, zone);
    compliance->update(state);
    const std::vector<int> tets = tets_where(model, zone, where);
    ASSERT_GT(tets.size(), 15u);
    // One by one, then a batch.
    for (int i = 0; i < 5; ++i) remove(model, state, *compliance, {tets[i]});
    compliance->update(state);
    expect_exact(model, state, *compliance, zone);
    remove(model, state, *compliance, {tets.begin() + 5, tets.begin() + 15});
    compliance->update(state);
    expect_exact(model, state, *compliance, zone);
    EXPECT_EQ(compliance->report().removed_since_reference, 15);
    // A patch across the zone's edge, with the terms.
    std::vector<int> wide = oracle::nearest(model, tip, 45);
    wide.erase(wide.begin(), wide.begin() + 20);
    expect_exact(model, state, *compliance, wide);
  }
}

// begin(b) is C b where the halves cover, on zone and halo, and finish(f) is C (b + f) for f there; carried
// terms and turned tissue included. An update ends what was begun.
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
    EXPECT_TRUE(compliance->halves_cover(with_halo ? near : zone));

    const VecX b = VecX::Random(3 * model.node_count());
    VecX f = VecX::Zero(b.size()), y(b.size()), whole(b.size());
    for (const int n : {zone[0], zone[7], zone[29]}) f.segment<3>(3 * n) = Vec3(1, -2, 3);
    if (with_halo) f.segment<3>(3 * halo[4]) = Vec3(-2, 0, 1);
    compliance->apply(b, whole);
    ASSERT_FALSE(compliance->begin(b, y));
    for (int n = 0; n < model.node_count(); ++n) {
      const bool known = compliance->halves_cover(std::span(&n, 1));
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
    compliance->finish(f, y);
    EXPECT_LT((y - whole).norm(), 1e-12 * whole.norm());
    EXPECT_THROW(compliance->finish(f, y), std::runtime_error);
    compliance->begin(b, y);
    compliance->update(state);
    EXPECT_THROW(compliance->finish(f, y), std::runtime_error);
  }
}

// A halo changes no result: it is out of the zone.
TEST(ZoneCompliance, TheRingIsOutsideAndRight) {
  const TissueModel model = box(4);
  std::vector<int> near = oracle::nearest(model, tip, 60);
  const std::vector<int> zone(near.begin(), near.begin() + 20), halo(near.begin() + 20, near.end());
  TissueState state = deformed(model, 8);
  const auto compliance = zone_method(model, zone);
  compliance->move_halo(halo);
  compliance->update(state);
  EXPECT_TRUE(compliance->zone_covers(zone));
  EXPECT_FALSE(compliance->zone_covers(std::vector<int>{halo[0]}));
  expect_exact(model, state, *compliance, zone);
  expect_exact(model, state, *compliance, near);
  remove(model, state, *compliance, {tets_where(model, zone, Where::outside)[0]});
  compliance->update(state);
  expect_exact(model, state, *compliance, near);
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
  EXPECT_EQ(make_compliance(ComplianceMethod::exact, model, h)->disagreement(state, y), 0);

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

TEST(ZoneCompliance, UntoldRemovalsAreFound) {
  const TissueModel model = box(3);
  const std::vector<int> zone = oracle::nearest(model, tip, 12);
  TissueState state = rest_state(model);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  remove_tets(model, state, std::vector<int>{1, 80, 120, 150});
  compliance->update(state);
  expect_exact(model, state, *compliance, zone);
}

TEST(ZoneCompliance, OrphansInAndOutOfTheZone) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  const auto around = [&](int node) {
    std::vector<int> tets;
    for (int t = 0; t < model.tet_count(); ++t)
      for (const int n : model.mesh.tets[t])
        if (n == node) tets.push_back(t);
    return tets;
  };
  TissueState state = deformed(model, 6);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  const int outside = oracle::nearest(model, Vec3(0, 0, 2e-3), 1).front();
  for (const int node : {zone[0], zone[29], outside}) {
    SCOPED_TRACE(node);
    // One element at a time: the last one leaves an orphan.
    for (const int t : around(node)) remove(model, state, *compliance, {t});
    ASSERT_EQ(state.live_tets_of_node[node], 0);
    compliance->update(state);
    expect_exact(model, state, *compliance, zone);
  }
}

TEST(ZoneCompliance, ABodyCutInTwoAndAFragmentSuckedOut) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  TissueState state = deformed(model, 7);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  // The layer of cells below the top one goes: the top floats, partly in the zone and partly out of it.
  std::vector<int> layer(96);
  std::iota(layer.begin(), layer.end(), 2 * 96);
  remove(model, state, *compliance, layer);
  compliance->update(state);
  expect_exact(model, state, *compliance, zone, 1e-9);
  const ComplianceReport cut = compliance->report();
  std::vector<int> top(96);
  std::iota(top.begin(), top.end(), 3 * 96);
  remove(model, state, *compliance, top);
  compliance->update(state);
  expect_exact(model, state, *compliance, zone, 1e-9);
  EXPECT_TRUE(cut.wants_reference);  // the cut is carried
  // A fragment that goes whole adds no terms.
  EXPECT_EQ(compliance->report().memory_bytes, cut.memory_bytes);
}

TEST(ZoneCompliance, CutToNothingMovesNothing) {
  const TissueModel model = box(3);
  std::vector<int> all(model.tet_count());
  std::iota(all.begin(), all.end(), 0);
  std::mt19937 random(8);
  std::shuffle(all.begin(), all.end(), random);
  TissueState state = deformed(model, 8);
  const std::vector<int> zone = oracle::nearest(model, tip, 20);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  VecX y(3 * model.node_count());
  for (std::size_t i = 0; i < all.size(); i += 9) {
    remove(model, state, *compliance, {all.begin() + i, all.begin() + i + 9});
    compliance->update(state);
    // Pieces of one element float by now; the terms carry them all.
    expect_exact(model, state, *compliance, zone, 1e-8);
  }
  compliance->apply(VecX::Ones(y.size()), y);
  EXPECT_EQ(y.norm(), 0);
}

TEST(ZoneCompliance, RemovalsWhileABaseIsMadeAreCarriedOver) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  const std::vector<int> next = oracle::nearest(model, Vec3(0, 0, 6e-3), 30);
  TissueState state = deformed(model, 9);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  remove(model, state, *compliance, {5, 200, 300});
  compliance->update(state);

  compliance->move_zone(next);
  auto reference = compliance->snapshot_reference(state);
  EXPECT_TRUE(compliance->zone_covers(zone));  // until it is adopted
  remove(model, state, *compliance, {6, 7, 201, 340, 350});
  compliance->update(state);
  expect_exact(model, state, *compliance, zone);
  std::thread([&] { reference->make(); }).join();
  compliance->adopt_reference(std::move(reference), state);
  EXPECT_TRUE(compliance->zone_covers(next));
  EXPECT_FALSE(compliance->zone_covers(zone));
  EXPECT_THROW(compliance->report(), std::runtime_error);  // no update yet
  compliance->update(state);
  expect_exact(model, state, *compliance, next);
  EXPECT_EQ(compliance->report().removed_since_reference, 5);
  EXPECT_EQ(compliance->report().reference_age, 1);
  // Once more, with the retired reference factor freed on the way.
  reference = compliance->snapshot_reference(state);
  reference->make();
  compliance->adopt_reference(std::move(reference), state);
  compliance->update(state);
  expect_exact(model, state, *compliance, next);
  EXPECT_EQ(compliance->report().removed_since_reference, 0);
}

TEST(ZoneCompliance, RefusesABaseThatIsNotMade) {
  const TissueModel model = box(2);
  const auto compliance = zone_method(model, {});
  const TissueState state = rest_state(model);
  EXPECT_THROW(compliance->adopt_reference(compliance->snapshot_reference(state), state),
               std::invalid_argument);
  EXPECT_THROW(compliance->adopt_reference(nullptr, state), std::invalid_argument);
  MatX block(3, 3);
  EXPECT_THROW(compliance->patch(std::vector<int>{20}, block), std::runtime_error);
  EXPECT_THROW(compliance->move_zone(std::vector<int>{27}), std::invalid_argument);
  compliance->update(state);
  EXPECT_THROW(compliance->patch(std::vector<int>{27}, block), std::invalid_argument);
}

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
    EXPECT_EQ(compliance->report().reference_age, trial + 2) << "a new base was needed";
  }
}

// A rigid turn of the whole floating body changes nothing but the axes: the warped reference factor is exact.
TEST(ZoneCompliance, ARigidTurnNeedsNoNewBase) {
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

// Pieces are followed through removals, mostly without finding them anew: the turns stay those of fresh
// pieces.
TEST(WarpRotation, PiecesAreFollowedThroughRemovals) {
  const TissueModel model = box(4, 1, false);
  TissueState state = rest_state(model);
  WarpRotation followed(model);
  std::vector<int> order(model.tet_count());
  std::iota(order.begin(), order.end(), 0);
  std::mt19937 random(21);
  // Half in layers, which cuts, half at random.
  std::shuffle(order.begin() + 192, order.end(), random);
  std::vector<Mat3> Q, expected;
  for (std::size_t i = 0; i + 7 < order.size(); i += 7) {
    remove_tets(model, state, std::vector<int>(order.begin() + i, order.begin() + i + 7));
    for (Mat3& R : state.rotation) R = random_rotation(random);
    followed.all(Warping::piece, state, Q);
    WarpRotation fresh(model);
    fresh.all(Warping::piece, state, expected);
    for (int n = 0; n < model.node_count(); ++n)
      ASSERT_LT((Q[n] - expected[n]).norm(), 1e-9) << i << " " << n;
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

TEST(ZoneCompliance, ANewBaseAtTheSameStateChangesNothing) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  const TissueState state = deformed(model, 13);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  MatX before(90, 90);
  compliance->patch(zone, before);
  auto reference = compliance->snapshot_reference(state);
  reference->make();
  compliance->adopt_reference(std::move(reference), state);
  compliance->update(state);
  MatX after(90, 90);
  compliance->patch(zone, after);
  EXPECT_LT((after - before).norm(), 1e-12 * before.norm());
}

// Past what may be carried, removals wait in the stale far field, and the report says so; unless the method
// may make a reference factor on the spot.
TEST(ZoneCompliance, WhatIsNotCarriedIsReported) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  const std::vector<int> tets = tets_where(model, zone, Where::outside);
  for (const bool synchronous : {false, true}) {
    ComplianceOptions options;
    options.most_carried = 8;
    options.synchronous_reference = synchronous;
    const auto compliance = zone_method(model, zone, options);
    TissueState state = deformed(model, 16);
    compliance->update(state);
    remove(model, state, *compliance, {tets.begin(), tets.begin() + 8});
    compliance->update(state);
    expect_exact(model, state, *compliance, zone);
    remove(model, state, *compliance, {tets.begin() + 8, tets.begin() + 12});
    compliance->update(state);
    if (synchronous) {
      expect_exact(model, state, *compliance, zone);
      EXPECT_EQ(compliance->report().removed_since_reference, 0);
    } else {
      EXPECT_GT(errors_of(model, state, *compliance, zone).apply, 1e-3);
      EXPECT_NE(compliance->report().health, ComplianceHealth::good);
      EXPECT_GT(compliance->report().residual, 1e-3);
    }
  }
}

// What is sampled only now and then is good only while nothing has moved since.
TEST(ZoneCompliance, HealthIsNeverOlderThanTheState) {
  const TissueModel model = box(3);
  const std::vector<int> zone = oracle::nearest(model, tip, 20);
  ComplianceOptions options;
  options.sample_every = 100;
  const auto compliance = zone_method(model, zone, options);
  TissueState state = rest_state(model);
  // Nothing is sampled in the step of a new reference factor, and a sample is spread over the two steps after
  // it.
  for (const ComplianceHealth expected :
       {ComplianceHealth::new_reference_wanted, ComplianceHealth::new_reference_wanted,
        ComplianceHealth::good, ComplianceHealth::good}) {
    compliance->update(state);
    EXPECT_EQ(compliance->report().health, expected);
  }
  state = deformed(model, 14);
  compliance->update(state);
  EXPECT_EQ(compliance->report().health, ComplianceHealth::new_reference_wanted);
}

TEST(ZoneCompliance, QuantisedReferenceGivesTheSamePatch) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  ComplianceOptions options;
  options.quantised_reference = true;
  const auto compliance = zone_method(model, zone, options);
  TissueState state = deformed(model, 15);
  compliance->update(state);
  remove(model, state, *compliance, {1, 2, 3, 301, 302});
  compliance->update(state);
  const Errors errors = errors_of(model, state, *compliance, zone);
  EXPECT_LT(errors.patch, 1e-10);
  EXPECT_LT(errors.apply, 5e-4);
  EXPECT_GT(errors.apply, 1e-12);
}

}  // namespace
}  // namespace hapticd
