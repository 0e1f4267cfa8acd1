// A patch that is viscous on the tick's own time: Kelvin and Voigt's answers by hand.
#include "haptic/contact/viscous_patch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <utility>

namespace hapticd {
namespace {

constexpr double h = 20e-3, T = 1e-3, beta = 2e-3;
constexpr double stiffness = 5;  // K of each node [N/m]

// Three nodes of one face of body 0, each on a spring of its own: C = 1/(K (1 + β/h)).
std::unique_ptr<CondensedProblem> face(std::uint64_t step, const Vec3& equilibrium, const Vec3& now) {
  auto p = std::make_unique<CondensedProblem>();
  p->step = step;
  p->nodes = 3;
  p->samples = 1;
  p->sample[0] = {.id = 7,
                  .node = {0, 1, 2},
                  .weight = {1. / 3, 1. / 3, 1. / 3},
                  .free = Vec3::Zero(),
                  .outward = Vec3::UnitZ(),
                  .friction = 0};
  for (int n = 0; n < 3; ++n) {
    p->x_now[n] = now;
    p->x_free[n] = (equilibrium + beta / h * now) / (1 + beta / h);
  }
  p->C().setZero();
  p->C().diagonal().setConstant(1 / (stiffness * (1 + beta / h)));
  return p;
}

double compliance_of(const CondensedProblem& p) { return p.column_scale[0] * p.C()(2, 2); }

ViscousOptions options() {
  ViscousOptions o;
  o.step = h;
  o.relaxation[0] = beta;
  return o;
}

// f = K x + β K v for a node driven at constant speed from rest: there at once, in every tick.
TEST(ViscousPatch, TissuePushedAtConstantSpeedPushesBackAtOnce) {
  const double speed = 0.02;
  const auto problem = face(1, Vec3::Zero(), Vec3::Zero());
  auto patch = std::make_unique<ViscousPatch>();
  for (int k = 1; k <= 30; ++k) {
    const CondensedProblem& p = at_tick(*problem, options(), T, *patch);
    const double x = speed * T * k;
    const double force = (x - p.x_free[0].z()) / compliance_of(p);
    EXPECT_NEAR(force, stiffness * (x + beta * speed), 1e-12) << k;
    PatchPositions after;
    after.fill(Vec3(0, 0, x));
    remember(after, *patch);
  }
}

// Ticks at will, as in mode `event`.
TEST(ViscousPatch, UnevenTicksFeelTheSameSpeed) {
  const double speed = 0.02;
  const auto problem = face(1, Vec3::Zero(), Vec3::Zero());
  auto patch = std::make_unique<ViscousPatch>();
  double t = 0;
  for (int k = 1; k <= 30; ++k) {
    const double period = k % 3 == 0 ? 0.5e-3 : T;
    t += period;
    const CondensedProblem& p = at_tick(*problem, options(), period, *patch);
    EXPECT_NEAR((speed * t - p.x_free[0].z()) / compliance_of(p), stiffness * (speed * t + beta * speed),
                1e-12)
        << k;
    PatchPositions after;
    after.fill(Vec3(0, 0, speed * t));
    remember(after, *patch);
  }
}

// Jitter of an arrival is not worth a new C_pp: it errs by its share of the viscous force, and no more.
TEST(ViscousPatch, JitterOfTheTickLeavesTheCompliance) {
  const double speed = 0.02;
  const auto problem = face(1, Vec3::Zero(), Vec3::Zero());
  auto patch = std::make_unique<ViscousPatch>();
  const double compliance = compliance_of(at_tick(*problem, options(), T, *patch));
  double t = 0;
  for (int k = 1; k <= 30; ++k) {
    const double period = (k % 2 == 0 ? 0.96 : 1.04) * T;
    t += period;
    const CondensedProblem& p = at_tick(*problem, options(), period, *patch);
    EXPECT_EQ(compliance_of(p), compliance);
    EXPECT_NEAR((speed * t - p.x_free[0].z()) / compliance_of(p), stiffness * (speed * t + beta * speed),
                0.0401 * stiffness * beta * speed)
        << k;
    PatchPositions after;
    after.fill(Vec3(0, 0, speed * t));
    remember(after, *patch);
  }
}

// Maxwell's element: with a lag a, the viscous force of a constant speed rises as implicit Euler has it,
// 1 − (a/(T + a))^k, and a single reading that jumps by Δ and back is worth β K Δ/(T + a) instead of β K Δ/T.
TEST(ViscousPatch, WithALagTheViscousForceRisesInIt) {
  const double speed = 0.02, a = 0.25e-3;
  const auto problem = face(1, Vec3::Zero(), Vec3::Zero());
  auto patch = std::make_unique<ViscousPatch>();
  ViscousOptions lagging = options();
  lagging.lag = a;
  for (int k = 1; k <= 30; ++k) {
    const CondensedProblem& p = at_tick(*problem, lagging, T, *patch);
    const double x = speed * T * k;
    const double force = (x - p.x_free[0].z()) / compliance_of(p);
    EXPECT_NEAR(force, stiffness * (x + beta * speed * (1 - std::pow(a / (T + a), k))), 1e-12) << k;
    PatchPositions after;
    after.fill(Vec3(0, 0, x));
    remember(after, *patch);
  }
  auto still = std::make_unique<ViscousPatch>();
  const CondensedProblem& p = at_tick(*problem, lagging, T, *still);
  const double quantum = 20e-6;
  EXPECT_NEAR((quantum - p.x_free[0].z()) / compliance_of(p), stiffness * quantum * (1 + beta / (T + a)),
              1e-15);
}

// 400 N/m read to 55 µm, as a Touch: 2.4 µJ a reading. 10 kN/m read to 20 µm: 8; 40 kN/m: 32.
TEST(ViscousPatch, LagsOnlyWhereAReadingIsWorthMuch) {
  EXPECT_EQ(lag_for(55e-6, 400, beta, T), 0);
  EXPECT_EQ(lag_for(20e-6, 10e3, beta, T), 0);
  EXPECT_GT(lag_for(20e-6, 40e3, beta, T), 0);
  EXPECT_EQ(lag_for(20e-6, 400e3, beta, T), 0);  // 16 N a reading
  EXPECT_EQ(lag_for(0, 1e6, beta, T), 0);
  EXPECT_EQ(lag_for(1e-3, 1e6, 0, T), 0);
}

TEST(ViscousPatch, LetGoItRelaxesToItsEquilibriumInBeta) {
  const Vec3 equilibrium(0, 0, 1e-3);
  const auto problem = face(1, equilibrium, Vec3::Zero());
  auto patch = std::make_unique<ViscousPatch>();
  PatchPositions x;
  x.fill(Vec3::Zero());
  at_tick(*problem, options(), T, *patch);
  remember(x, *patch);
  for (int k = 1; k <= 40; ++k) {
    const CondensedProblem& p = at_tick(*problem, options(), T, *patch);
    EXPECT_NEAR(p.x_free[1].z(), 1e-3 * (1 - std::pow(1 + T / beta, -k)), 1e-12);
    remember(p.x_free, *patch);
  }
}

// A tick in two parts, of which the first belongs to the problem before.
TEST(ViscousPatch, ATickInPartsRelaxesForThemOneAfterTheOther) {
  const double part = 0.4e-3;
  const Vec3 equilibrium(0, 0, 1e-3);
  const auto first = face(1, equilibrium, Vec3::Zero()), second = face(2, equilibrium, Vec3::Zero());
  auto patch = std::make_unique<ViscousPatch>();
  EXPECT_EQ(at_part_of_tick(part, *patch), nullptr) << "nothing is remembered";
  PatchPositions x;
  x.fill(Vec3::Zero());
  at_tick(*first, options(), T, *patch);
  remember(x, *patch);
  const CondensedProblem* p = at_part_of_tick(part, *patch);
  ASSERT_NE(p, nullptr);
  EXPECT_NEAR(p->x_free[1].z(), 1e-3 * (1 - 1 / (1 + part / beta)), 1e-15);
  EXPECT_NEAR(compliance_of(*p), 1 / (stiffness * (1 + beta / part)), 1e-15);
  remember(p->x_free, *patch);
  EXPECT_NEAR(at_tick(*second, options(), T - part, *patch).x_free[1].z(),
              1e-3 * (1 - 1 / (1 + part / beta) / (1 + (T - part) / beta)), 1e-15);
}

// C_pp is read where it was published, and not at all when that has become another problem's.
TEST(ViscousPatch, TheComplianceIsLent) {
  const auto first = face(1, Vec3::Zero(), Vec3::Zero()), second = face(2, Vec3::Zero(), Vec3::Zero());
  auto patch = std::make_unique<ViscousPatch>();
  const CondensedProblem& p = at_tick(*first, options(), T, *patch);
  EXPECT_EQ(p.C().data(), std::as_const(*first).C().data());
  EXPECT_EQ(at_part_of_tick(T / 2, *patch), &p);
  EXPECT_EQ(at_tick(*second, options(), T, *patch).C().data(), std::as_const(*second).C().data());
  second->step = 3;
  EXPECT_EQ(at_part_of_tick(T / 2, *patch), nullptr);

  const auto copy = std::make_unique<CondensedProblem>();
  copy_in_use(p, *copy);
  EXPECT_EQ(copy->lender, nullptr);
  EXPECT_EQ(copy->C(), std::as_const(*second).C());

  // Who writes it has a copy.
  patch->problem.C()(0, 0) = 7;
  EXPECT_EQ(p.C()(0, 0), 7);
  EXPECT_EQ(p.C()(8, 8), std::as_const(*second).C()(8, 8));
  EXPECT_NE(std::as_const(*second).C()(0, 0), 7);
}

TEST(ViscousPatch, AtRestNothingChangesBetweenProblems) {
  const Vec3 place(1e-3, 2e-3, 3e-3);
  auto patch = std::make_unique<ViscousPatch>();
  for (std::uint64_t step = 1; step < 4; ++step) {
    const auto problem = face(step, place, place);
    const CondensedProblem& p = at_tick(*problem, options(), T, *patch);
    for (int n = 0; n < 3; ++n) EXPECT_LT((p.x_free[n] - place).norm(), 1e-17);
    remember(p.x_free, *patch);
  }
}

// The same face under another numbering of the patch's nodes.
TEST(ViscousPatch, CarriesPlacesFromProblemToProblemByTheirSamples) {
  auto patch = std::make_unique<ViscousPatch>();
  const auto first = face(1, Vec3::Zero(), Vec3::Zero()), second = face(2, Vec3::Zero(), Vec3::Zero());
  at_tick(*first, options(), T, *patch);
  PatchPositions x;
  for (int n = 0; n < 3; ++n) x[n] = Vec3(n + 1, 0, 0);
  remember(x, *patch);
  second->sample[0].node = {2, 0, 1};
  const CondensedProblem& p = at_tick(*second, options(), T, *patch);
  const double kept = (beta / T) / (1 + beta / T);
  EXPECT_NEAR(p.x_free[2].x(), kept * 1, 1e-15);
  EXPECT_NEAR(p.x_free[0].x(), kept * 2, 1e-15);
  EXPECT_NEAR(p.x_free[1].x(), kept * 3, 1e-15);
}

// A face that comes into the patch, or that a removal uncovers, was held where it is, and comes up as its
// viscosity lets it.
TEST(ViscousPatch, WhatIsNewBeginsWhereItIs) {
  const Vec3 held(0, 0, -1e-3);
  const auto first = face(1, Vec3::Zero(), Vec3::Zero()), second = face(2, Vec3::Zero(), held);
  second->sample[0].id = 8;
  auto patch = std::make_unique<ViscousPatch>();
  at_tick(*first, options(), T, *patch);
  const CondensedProblem& p = at_tick(*second, options(), T, *patch);
  EXPECT_NEAR(p.x_free[0].z(), beta / T * held.z() / (1 + beta / T), 1e-15);
  EXPECT_EQ(p.x_now[0], held);  // where a solve without its forces begins
}

TEST(ViscousPatch, WithoutViscosityOrWithFrozenRowsTheProblemIsTheOnePublished) {
  auto patch = std::make_unique<ViscousPatch>();
  const auto problem = face(1, Vec3::Zero(), Vec3::Zero());
  EXPECT_EQ(&at_tick(*problem, {.step = h, .relaxation = {}}, T, *patch), problem.get());
  EXPECT_EQ(&at_tick(*problem, {}, T, *patch), problem.get());
  problem->renewal = Renewal::frozen;
  EXPECT_EQ(&at_tick(*problem, options(), T, *patch), problem.get());
}

}  // namespace
}  // namespace hapticd
