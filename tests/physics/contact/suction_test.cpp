// Suction against hand answers: p A on a covered port, the pump's exponential, a block that hangs.
#include "physics/contact/suction.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "tests/support/bodies.h"
#include "tests/support/suction_sheet.h"

namespace hapticd {
namespace {

using namespace suction;

Suction pulled(const CondensedProblem& problem, const Pose& X, PatchPositions& pull) {
  pull.fill(Vec3::Zero());
  return suction_of(problem, needle(), X, problem.x_free, vacuum, pull);
}

Vec3 sum_of(const CondensedProblem& problem, const PatchPositions& pull) {
  Vec3 sum = Vec3::Zero();
  for (int n = 0; n < problem.nodes; ++n) sum += pull[n];
  return sum;
}

// Wherever the port is on it, and however it is turned: Δp A along the port, and the same on the needle,
// whose torque balances that of the tissue's forces about any point.
TEST(Suction, ACoveredPortPullsWithItsPressureTimesItsArea) {
  auto problem = sheet(4e-3, 10, 0);
  PatchPositions pull;
  for (int i = 0; i < 50; ++i) {
    const Pose X{Vec3(17e-6 * i, -11e-6 * i, 0),
                 Quat(Eigen::AngleAxisd(1e-3 * i, Vec3(1, 2, 0).normalized()))};
    const Suction s = pulled(*problem, X, pull);
    EXPECT_EQ(s.occlusion, 1);
    const Vec3 expected = vacuum * port_area * (X.q * Vec3::UnitZ());
    EXPECT_LT((sum_of(*problem, pull) - expected).norm(), 1e-12 * expected.norm());
    EXPECT_LT((s.load.head<3>() + expected).norm(), 1e-12 * expected.norm());
    Vec3 moment = s.load.tail<3>() + X.p.cross(Vec3(s.load.head<3>()));
    for (int n = 0; n < problem->nodes; ++n) moment += problem->x_free[n].cross(pull[n]);
    EXPECT_LT(moment.norm(), 1e-15);
  }
}

// A sheet's edge across the middle of the port covers half of it; one beyond the reach nothing.
TEST(Suction, FallsWithWhatThePortIsCoveredBy) {
  auto problem = sheet(4e-3, 10, 0);
  PatchPositions pull;
  const Suction half = pulled(*problem, {Vec3(2e-3, 0, 0), Quat::Identity()}, pull);
  EXPECT_NEAR(half.occlusion, 0.5 / 0.9, 0.06);
  EXPECT_EQ(pulled(*problem, {Vec3(0, 0, 0.1499e-3), Quat::Identity()}, pull).occlusion, 1);
  const double mid = pulled(*problem, {Vec3(0, 0, 0.225e-3), Quat::Identity()}, pull).occlusion;
  EXPECT_NEAR(mid, 0.5 / 0.9, 0.05);
  EXPECT_EQ(pulled(*problem, {Vec3(0, 0, 0.3001e-3), Quat::Identity()}, pull).occlusion, 0);
  EXPECT_EQ(sum_of(*problem, pull), Vec3::Zero());
}

// Continuous: a hand that moves by a micrometre changes the force by little of its whole.
TEST(Suction, ComesAndGoesByDegrees) {
  auto problem = sheet(4e-3, 10, 0);
  PatchPositions pull;
  double before = -1, largest = 0;
  for (int i = 0; i < 4000; ++i) {
    const double f =
        pulled(*problem, {Vec3(1.4e-3 + 1e-6 * i, 0.1e-3, 0.1e-3), Quat::Identity()}, pull).load.norm();
    if (before >= 0) largest = std::max(largest, std::abs(f - before));
    before = f;
  }
  EXPECT_LT(largest, 0.02 * vacuum * port_area);
}

// n times a third of what is left: 1 − (2/3)ⁿ; and nothing at once when the port is gone.
TEST(Suction, APortTakesHoldByDegreesAndLetsGoAtOnce) {
  auto problem = sheet(4e-3, 10, 0);
  PatchPositions pull;
  const Pose edge{Vec3(2e-3, 0, 0), Quat::Identity()}, away{Vec3(2e-3, 0, 1e-3), Quat::Identity()};
  const double whole = pulled(*problem, edge, pull).occlusion;
  ASSERT_LT(whole, 0.7);
  Grip grip{};
  const auto occlusion = [&](const Pose& X) {
    return suction_of(*problem, needle(), X, problem->x_free, vacuum, pull, &grip, 1.0 / 3).occlusion;
  };
  for (int n = 1; n < 20; ++n) EXPECT_NEAR(occlusion(edge), whole * (1 - std::pow(2.0 / 3, n)), 1e-12);
  EXPECT_EQ(occlusion(away), 0);
  EXPECT_NEAR(occlusion(edge), whole / 3, 1e-12);
}

// One node of the sheet is moved: by more than the port is wide and reaches (1.3 mm) those samples that it
// carries with a weight of more than 1.3 mm of its way.
TEST(Suction, WhatIsThrownIsLetGo) {
  auto problem = sheet(4e-3, 10, 0);
  PatchPositions pull, x = problem->x_free;
  EachInstrument<Grip> grip;
  for (Grip& g : grip.value) g.fill(0);
  suction_of(*problem, needle(), Pose{}, problem->x_free, vacuum, pull, &grip[0], 1);
  const Grip before = grip[0];
  constexpr int middle = 60;
  constexpr double most = 2 * port_radius + 0.3e-3, way = 3e-3;
  x[middle] += Vec3(0, way, 0);
  EXPECT_TRUE(let_go(*problem, needle(), problem->x_free, x, grip));
  int gone = 0;
  for (int k = 0; k < problem->samples; ++k) {
    double weight = 0;
    for (int c = 0; c < 3; ++c)
      if (problem->sample[k].node[c] == middle) weight = problem->sample[k].weight[c];
    const bool thrown = weight * way > most;
    EXPECT_EQ(grip[0][k], thrown ? 0 : before[k]);
    gone += thrown && before[k] > 0;
  }
  EXPECT_GT(gone, 3);
  EXPECT_FALSE(let_go(*problem, needle(), problem->x_free, x, grip)) << "it already is";
}

TEST(Suction, ThePumpRisesAndVentsWithItsTimeConstant) {
  const Port port = needle().port;
  double p = 0, t = 0;
  for (; t < 0.6 - 1e-9; t += 1e-3) p = pumped(port, p, 1, true, 1e-3);
  EXPECT_NEAR(p, vacuum * (1 - std::exp(-t / port.rise_time)), 2e-3 * vacuum);
  const double full = p;
  for (t = 0; t < 0.3 - 1e-9; t += 1e-3) p = pumped(port, p, 1, false, 1e-3);
  EXPECT_NEAR(p, full * std::exp(-1.0), 2e-3 * vacuum);
  EXPECT_NEAR(pumped(port, 0, 0.5, true, 1e9), vacuum / 2, 1e-3);
  EXPECT_EQ(pumped(Port{}, 5, 1, true, 1e-3), 0);
}

// A peristaltic pump: occluded it fills its tubing's compliance, so the vacuum rises evenly and stops at its
// largest; half covered it comes to p_max o/(1 − o), at most the largest; open it vents with its time
// constant.
TEST(Suction, APumpWithAFlowRisesEvenlyWhileOccluded) {
  Port port = needle().port;
  port.flow = 5e-7;
  const double compliance = port.flow * port.rise_time / vacuum;  // of the tubing [m³/Pa]
  double p = 0;
  for (int ms = 1; ms <= 600; ++ms) {
    p = pumped(port, p, 1, true, 1e-3);
    EXPECT_NEAR(p, std::min(vacuum, port.flow / compliance * 1e-3 * ms), 1e-9 * vacuum);
  }
  EXPECT_EQ(p, vacuum);
  for (int ms = 0; ms < 300; ++ms) p = pumped(port, p, 0, true, 1e-3);
  EXPECT_NEAR(p, vacuum * std::exp(-1.0), 2e-3 * vacuum);
  for (int ms = 0; ms < 300; ++ms) p = pumped(port, p, 1, false, 1e-3);
  EXPECT_NEAR(p, vacuum * std::exp(-2.0), 2e-3 * vacuum);
  for (int ms = 0; ms < 5000; ++ms) p = pumped(port, p, 0.25, true, 1e-3);
  EXPECT_NEAR(p, vacuum / 3, 1e-6 * vacuum);
  for (int ms = 0; ms < 5000; ++ms) p = pumped(port, p, 0.6, true, 1e-3);
  EXPECT_EQ(p, vacuum);
}

TEST(Suction, IsTakenOutOfTheProblemAgain) {
  auto problem = sheet(4e-3, 8, 0);
  problem->C() = MatX::Identity(3 * problem->nodes, 3 * problem->nodes);
  const PatchPositions free = problem->x_free;
  const EachInstrument<double> o =
      apply_suction(needle(), Pose{}, Pose{}, problem->x_free, EachInstrument<double>(vacuum), *problem);
  EXPECT_EQ(o[0], 1);
  EXPECT_GT((problem->x_free[40] - free[40]).norm(), 1e-6);
  EXPECT_LT(problem->instrument[0].load.z(), 0);
  remove_suction(*problem);
  for (int n = 0; n < problem->nodes; ++n) EXPECT_LT((problem->x_free[n] - free[n]).norm(), 1e-18);
  EXPECT_TRUE(problem->instrument[0].load.isZero(0));
}

// A loose block of tissue of 0.4 mN under a needle that holds it with p · 0.79 mm².
struct HangingBlock : testing::Test {
  static constexpr double g = 100;
  const Material material{
      .young = 20e3, .poisson = 0.4, .density = 1000, .rayleigh_mass = 2, .rayleigh_stiffness = 2e-3};

  std::unique_ptr<World> world(bool pieces) const {
    std::vector<BodySettings> bodies;
    bodies.push_back(block("piece", {2e-3, 2e-3, 1e-3}, {8, 8, 4}, material,
                           {Vec3(-1e-3, -1e-3, -1e-3), Quat::Identity()}));
    bodies.push_back(
        slab("floor", {8e-3, 8e-3, 1e-3}, {2, 2, 1}, {Vec3(-4e-3, -4e-3, -12e-3), Quat::Identity()}));
    WorldSettings s =
        contact_world(pieces ? std::vector<ContactPair>{{0, 1, 0}} : std::vector<ContactPair>{});
    s.alarm_distance = 0.5e-3;
    s.sample_spacing = 0.3e-3;
    s.gravity = Vec3(0, 0, -g);
    s.lead = pieces ? 0 : 0.02;
    s.coupling[0] = {50, 1e-3, 0};
    return std::make_unique<World>(std::move(bodies), needle(), s);
  }
};

TEST_F(HangingBlock, IsHeldAgainstItsWeightAndFeltByTheHand) {
  for (const bool pieces : {false, true}) {
    const auto w = world(pieces);
    const double weight = g * mass_of(w->bodies()[0]);
    ASSERT_LT(weight, 0.6 * vacuum * port_area);
    InstrumentSample sample = at(Vec3::Zero());
    sample.vacuum = vacuum;
    CondensedProblem& problem = *new CondensedProblem;
    const std::unique_ptr<CondensedProblem> owner(&problem);
    StepReport report;
    for (int i = 0; i < 250; ++i) report = w->step([&] { return InstrumentSamples(sample); }, problem);
    // The coupling gives by weight/K, 8 µm; the block stretches by less than weight · height/(E · area of the
    // port).
    const double stretch = weight * 1e-3 / (material.young * port_area);
    const double z = centre_of(w->bodies()[0]).z() + 0.5e-3 + weight / 50;
    EXPECT_LT(z, 1e-6) << pieces;
    EXPECT_GT(z, -stretch) << pieces;
    EXPECT_LT(velocity_of(w->bodies()[0]).norm(), 1e-5) << pieces;
    EXPECT_NEAR(report.contact.wrench[0].z(), -weight, 0.01 * weight) << pieces;
    EXPECT_TRUE(problem.instrument[0].load.isZero(0)) << "published without: the haptic loop has its own";
  }
}

TEST_F(HangingBlock, FallsWhereThePressureIsLessThanItsWeight) {
  const auto w = world(false);
  InstrumentSample sample = at(Vec3::Zero());
  sample.vacuum = 0.8 * g * mass_of(w->bodies()[0]) / port_area;
  const auto problem = std::make_unique<CondensedProblem>();
  for (int i = 0; i < 5; ++i) w->step([&] { return InstrumentSamples(sample); }, *problem);
  EXPECT_LT(centre_of(w->bodies()[0]).z(), -0.6e-3);
}

}  // namespace
}  // namespace hapticd
