// Method zone in tissue that splits: exact while nothing moved, definite always, its corner grows.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <thread>

#include "tests/physics/compliance/cut_by_hand.h"
#include "tests/physics/compliance/zone/zone_bench.h"

namespace hapticd {
namespace {

using namespace zone_bench;
using by_hand::cut_at;

struct Bench {
  explicit Bench(unsigned seed, ComplianceOptions options = {}, bool held = true)
      : model(by_hand::box_with_room(4, {60, 300}, held)),
        zone(oracle::nearest(model, tip, 30)),
        state(oracle::deformed(model, seed)),
        compliance(zone_method(model, zone, options)),
        random(seed) {
    compliance->update(state);
  }

  // All of its tetrahedra are there, or for `across`, some are. −1: there is none.
  int node(Where where) {
    std::vector<int> nodes;
    for (int n = 0; n < model.nodes_in_use; ++n) {
      const std::vector<int> star = by_hand::around(model, state, n, n);
      const auto there = std::count_if(star.begin(), star.end(), [&](int t) { return here(t) == where; });
      if (!model.fixed[n] && there > 0 && (where == Where::across || there == std::ssize(star)))
        nodes.push_back(n);
    }
    return nodes.empty() ? -1 : nodes[random() % nodes.size()];
  }
  Where here(int t) const { return oracle::where(model, corner(), t); }
  std::vector<int> corner() const {
    std::vector<int> nodes = zone;
    for (int n = 0; n < model.nodes_in_use; ++n)
      if (!model.fixed[n] && compliance->zone_covers(std::span(&n, 1)) &&
          std::ranges::find(zone, n) == zone.end())
        nodes.push_back(n);
    return nodes;
  }
  bool cut(Where where) {
    const int n = node(where);  // what is cut outside is inside then: in the end none is left
    return n >= 0 && !cut_at(model, state, *compliance, n, random).empty();
  }

  TissueModel model;
  int first_new = model.nodes_in_use;
  std::vector<int> zone;
  TissueState state;
  std::unique_ptr<ReferenceCompliance> compliance;
  std::mt19937 random;
};

TEST(ZoneCut, IsExactInsideAcrossAndOutside) {
  for (const Where where : {Where::inside, Where::across, Where::outside})
    for (unsigned seed = 1; seed <= 3; ++seed) {
      SCOPED_TRACE(seed);
      Bench b(seed);
      int cuts = 0;
      for (int k = 0; k < 20; ++k) {
        cuts += b.cut(where);
        if (k % 4 == 3)
          remove(b.model, b.state, *b.compliance, {static_cast<int>(b.random() % b.model.tets_in_use)});
        if (k % 5 != 4) continue;
        b.compliance->update(b.state);
        expect_exact(b.model, b.state, *b.compliance, b.corner());
        EXPECT_TRUE(b.compliance->zone_covers(b.corner()));
        EXPECT_EQ(b.compliance->report().appended_since_reference, b.model.nodes_in_use - b.first_new);
        // Nodes outside, mixed with appended ones.
        const std::vector<int> corner = b.corner();
        std::vector<int> wide = {8, 30, 55, 90};
        wide.insert(wide.end(), corner.end() - 3, corner.end());
        expect_exact(b.model, b.state, *b.compliance, wide);
      }
      // In the end nothing is outside: what was cut there has joined the corner.
      EXPECT_GT(cuts, where == Where::outside ? 4 : 9);
    }
}

// Elements wholly in the corner at their present rotations, all others at the reference's: of an element of a
// cut, at its ancestor's.
TEST(ZoneCut, TurnsWhatIsInsideAlone) {
  for (unsigned seed = 4; seed <= 6; ++seed) {
    ComplianceOptions options;
    options.warping = Warping::none;
    options.sample_every = 1 << 30;
    Bench b(seed, options);
    const std::vector<Mat3> reference = b.state.rotation;
    for (int k = 0; k < 12; ++k)
      b.cut(k % 3 == 0 ? Where::inside : k % 3 == 1 ? Where::across : Where::outside);
    for (int n = 0; n < b.model.nodes_in_use; ++n)
      if (!b.model.fixed[n]) b.state.x[n] += random_vector(b.random, 4e-4);
    update_rotations(b.model, b.state);
    for (int k = 0; k < 6; ++k) b.cut(k % 2 == 0 ? Where::inside : Where::across);
    b.compliance->update(b.state);
    TissueState mixed = b.state;
    for (int t = 0; t < b.model.tets_in_use; ++t) {
      int from = t;
      while (b.model.parent[from] != from) from = b.model.parent[from];
      if (b.here(t) != Where::inside) mixed.rotation[t] = reference[from];
    }
    const Errors errors = errors_of(b.model, mixed, *b.compliance, b.corner());
    EXPECT_LT(errors.patch, 1e-10);
    EXPECT_LT(errors.apply, 1e-10);
  }
}

TEST(ZoneCut, ARigidTurnNeedsNoNewReference) {
  Bench b(7, {}, false);
  for (int k = 0; k < 9; ++k) b.cut(k % 2 == 0 ? Where::inside : Where::outside);
  const Mat3 R = Eigen::AngleAxisd(1.2, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  for (Vec3& x : b.state.x) x = R * x;
  for (Mat3& r : b.state.rotation) r = R * r;
  b.compliance->update(b.state);
  const Errors errors = errors_of(b.model, b.state, *b.compliance, b.corner());
  EXPECT_LT(errors.patch, 1e-9);
  EXPECT_LT(errors.apply, 1e-9);
}

// S ≥ M(now), as without cuts.
TEST(ZoneCut, IsDefiniteHoweverEverythingTurned) {
  ComplianceOptions options;
  options.usable_error = 1e30;
  Bench b(8, options);
  std::uniform_real_distribution<double> angle(-3.1, 3.1);
  for (int trial = 0; trial < 24; ++trial) {
    b.cut(trial % 3 == 0 ? Where::inside : trial % 3 == 1 ? Where::across : Where::outside);
    for (Mat3& R : b.state.rotation)
      R = Eigen::AngleAxisd(angle(b.random), random_vector(b.random, 1.0).normalized()).toRotationMatrix();
    b.compliance->update(b.state);
    std::vector<int> live;
    double least_mass = 1;
    for (const int n : b.corner()) {
      if (!oracle::in_system(b.model, b.state, n)) continue;
      live.push_back(n);
      least_mass = std::min(least_mass, b.state.mass[n]);
    }
    MatX block(3 * live.size(), 3 * live.size());
    b.compliance->patch(live, block);
    const Eigen::SelfAdjointEigenSolver<MatX> eigen(block, Eigen::EigenvaluesOnly);
    EXPECT_GT(eigen.eigenvalues().minCoeff(), 0);
    EXPECT_LE(
        eigen.eigenvalues().maxCoeff() * (1 / (h * h) + b.model.material.rayleigh_mass / h) * least_mass,
        1 + 1e-9);
    EXPECT_EQ(b.compliance->report().reference_age, trial + 2) << "a new reference factor was needed";
  }
}

// The snapshot is made on another thread while the model grows; what was cut meanwhile is carried over.
TEST(ZoneCut, CutsWhileAReferenceIsMadeAreCarriedOver) {
  for (unsigned seed = 9; seed <= 12; ++seed) {
    Bench b(seed);
    const auto cut_all = [&](int count) {
      for (int k = 0; k < count; ++k)
        b.cut(k % 3 == 0 ? Where::inside : k % 3 == 1 ? Where::across : Where::outside);
    };
    for (int round = 0; round < 3; ++round) {
      cut_all(3);
      b.zone = oracle::nearest(b.model, round % 2 == 0 ? Vec3(0, 0, 6e-3) : tip, 30);
      b.compliance->move_zone(b.zone);
      auto reference = b.compliance->snapshot_reference(b.state);
      const int known = b.model.nodes_in_use;
      std::thread maker([&] { reference->make(); });
      for (int k = 0; k < 8; ++k)
        cut_at(b.model, b.state, *b.compliance, static_cast<int>(b.random() % b.model.nodes_in_use),
               b.random);
      remove(b.model, b.state, *b.compliance, {2, 70 + round, b.model.tets_in_use - 1});
      maker.join();
      b.compliance->adopt_reference(std::move(reference), b.state);
      b.first_new = known;
      b.compliance->update(b.state);
      expect_exact(b.model, b.state, *b.compliance, b.corner());
      EXPECT_EQ(b.compliance->report().appended_since_reference, b.model.nodes_in_use - known);
      cut_all(2);
      b.compliance->update(b.state);
      expect_exact(b.model, b.state, *b.compliance, b.corner());
    }
  }
}

// Beyond its room the corner goes on growing; or a reference factor is made at once, where that is allowed.
TEST(ZoneCut, BeyondItsRoomItStaysExact) {
  for (const bool synchronous : {false, true}) {
    ComplianceOptions options;
    options.most_appended = 4;
    options.synchronous_reference = synchronous;
    Bench b(13, options);
    for (int k = 0; k < 9;) k += b.cut(Where::inside);
    b.compliance->update(b.state);
    EXPECT_EQ(b.compliance->report().appended_since_reference, synchronous ? 0 : 9);
    EXPECT_EQ(b.compliance->report().wants_reference, !synchronous);
    expect_exact(b.model, b.state, *b.compliance, b.zone);
  }
}

TEST(ZoneCut, HalvesAreTheWhole) {
  Bench b(14);
  for (int k = 0; k < 9; ++k) b.cut(k % 2 == 0 ? Where::inside : Where::across);
  for (Vec3& x : b.state.x) x = Eigen::AngleAxisd(0.3, Vec3::UnitX()) * x;
  update_rotations(b.model, b.state);
  b.compliance->update(b.state);
  const std::vector<int> corner = b.corner();
  EXPECT_TRUE(b.compliance->forward_covers(corner));
  const VecX load = oracle::load(3 * b.model.node_count());
  VecX f = VecX::Zero(load.size()), y(load.size()), whole(load.size());
  for (const int n : {b.zone[3], corner.back(), corner[corner.size() - 3]})
    f.segment<3>(3 * n) = Vec3(1, -2, 3);
  b.compliance->apply(load, whole);
  ASSERT_EQ(b.compliance->start_solve(load, y), Solved::forward);
  for (const int n : corner) EXPECT_LT((y - whole).segment<3>(3 * n).norm(), 1e-12 * whole.norm());
  b.compliance->apply(load + f, whole);
  b.compliance->finish_solve(f, y);
  EXPECT_LT((y - whole).norm(), 1e-12 * whole.norm());
  b.compliance->apply(f, whole);
  b.compliance->apply_in_zone(f, y);
  for (const int n : corner) EXPECT_LT((y - whole).segment<3>(3 * n).norm(), 1e-12 * whole.norm());
}

}  // namespace
}  // namespace hapticd
