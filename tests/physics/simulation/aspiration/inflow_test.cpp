// Pieces that fluid carries into a port, against the law's own motion.
#include "physics/simulation/aspiration/inflow.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "tests/support/bodies.h"
#include "tests/support/suction_sheet.h"

namespace hapticd {
namespace {

using suction::needle;

constexpr double flow = 5e-7;  // 30 ml/min
constexpr double h = 0.02;

Instrument pump() {
  Instrument instrument = needle();
  instrument.port.flow = flow;
  return instrument;
}

// A block of 0.5 mm, this far before the port.
BodySettings piece(double density, double away) {
  return block("piece", {0.5e-3, 0.5e-3, 0.5e-3}, {1, 1, 1}, {20e3, 0.4, density, 0, 2e-3},
               {Vec3(-0.25e-3, -0.25e-3, -0.25e-3 - away), Quat::Identity()});
}

double drag() {  // c of the block
  return 6 * std::numbers::pi * fluid_viscosity * std::cbrt(3 * 0.125e-9 / (4 * std::numbers::pi));
}

struct Drawn {
  std::unique_ptr<World> world;
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  InstrumentSample hand = at(Vec3::Zero());
  StepReport report;

  Drawn(double density, double away) {
    std::vector<BodySettings> bodies;
    bodies.push_back(piece(density, away));
    WorldSettings s = contact_world({});
    s.h = h;
    s.alarm_distance = 0.3e-3;
    s.sample_spacing = 0.1e-3;
    s.coupling[0] = {50, 1e-3, 2e-3};
    world = std::make_unique<World>(std::move(bodies), pump(), s);
    hand.aspiration = true;
  }
  void step() {
    report = world->step([&] { return InstrumentSamples(hand); }, *problem);
  }
  double away() const { return -centre_of(world->bodies()[0]).z(); }
  double speed() const { return velocity_of(world->bodies()[0]).z(); }
};

// One step from rest: F = c u m/(m + h c), u the mean speed of what flows along, shared out by mass.
TEST(Inflow, TheLoadIsStokesDragOfTheMeanSpeed) {
  Bodies bodies;
  bodies.emplace_back(piece(1000, 5e-3), h, Vec3::Zero());
  EachInstrument<double> q;
  q[0] = flow;
  carry_along(bodies, pump(), Pose{}, q, h);
  const double r = 5e-3, mass = 0.125e-6, c = drag();
  const double u = (r - std::cbrt(r * r * r - 3 * flow * h / (2 * std::numbers::pi))) / h;
  EXPECT_NEAR(u, flow / (2 * std::numbers::pi * r * r), 0.02 * u);
  Vec3 sum = Vec3::Zero();
  for (const Vec3& f : bodies[0].state.load) sum += f;
  EXPECT_NEAR(sum.z(), c * u * mass / (mass + h * c), 1e-9 * sum.z());
  EXPECT_LT(sum.head<2>().norm(), 1e-12 * sum.z());
  q[0] = 0;
  carry_along(bodies, pump(), Pose{}, q, h);
  EXPECT_TRUE(bodies[0].state.load.empty());
}

// A piece with next to no mass goes as fast as the fluid: r³ falls evenly.
TEST(Inflow, ALightPieceComesWithTheFluid) {
  Drawn d(1, 5e-3);
  double t = 0, before = d.away();
  for (; d.away() > 2e-3; t += h) {
    before = d.away();
    d.step();
    if (t > 3 * h) {
      const double u = (before - std::cbrt(std::pow(before, 3) - 3 * flow * h / (2 * std::numbers::pi))) / h;
      ASSERT_NEAR(d.speed(), u, 0.02 * u) << t;
    }
    ASSERT_LT(t, 1);
  }
  // Where the last step began, for the time it began.
  const double law = std::cbrt(125e-9 - 3 * flow * (t - 2 * h) / (2 * std::numbers::pi));
  EXPECT_NEAR(before, law, 0.03 * 5e-3);
}

// One of water's density lags: the motion of m r̈ = −c (q/2πr² − |ṙ|) by a fine integration.
TEST(Inflow, APieceOfTissueFollowsItsEquationOfMotion) {
  Drawn d(1000, 4e-3);
  for (int i = 0; i < 10; ++i) d.step();
  double r = 4e-3, v = 0;
  const double fine = 1e-6;
  for (double t = 0; t < 9 * h; t += fine) {  // the first step's load acts in the second
    v += fine * drag() / 0.125e-6 * (flow / (2 * std::numbers::pi * r * r) - v);
    r -= fine * v;
  }
  EXPECT_GT(4e-3 - r, 0.3e-3);
  EXPECT_NEAR(4e-3 - d.away(), 4e-3 - r, 0.1 * (4e-3 - r));
  EXPECT_NEAR(d.speed(), v, 0.1 * v);
}

// It comes to the port, covers it as far as it is wide, and the flow is what is left open; nothing is drawn
// without the pedal, and nothing that is behind the port.
TEST(Inflow, APieceIsDrawnInAndStopsTheFlow) {
  Drawn d(1000, 3e-3);
  d.hand.aspiration = false;
  for (int i = 0; i < 20; ++i) d.step();
  EXPECT_NEAR(d.away(), 3e-3, 1e-9);
  EXPECT_EQ(d.report.flow[0], 0);
  d.hand.aspiration = true;
  d.step();
  EXPECT_NEAR(d.report.flow[0], flow, 1e-18);
  int steps = 0;
  for (; d.away() > 0.6e-3 && steps < 200; ++steps) d.step();
  EXPECT_LT(steps, 200);
  d.hand.vacuum = 500;
  for (int i = 0; i < 50; ++i) d.step();
  EXPECT_LT(d.away(), 0.35e-3);
  EXPECT_GT(d.away(), 0.2e-3);
  EXPECT_NEAR(d.report.flow[0], flow * (1 - d.report.occlusion[0]), 1e-12 * flow);
  EXPECT_GT(d.report.occlusion[0], 0.2);
}

TEST(Inflow, WhatIsBehindThePortIsLeftAlone) {
  Drawn d(1000, -8e-3);
  for (int i = 0; i < 20; ++i) d.step();
  EXPECT_NEAR(d.away(), -8e-3, 1e-9);
}

}  // namespace
}  // namespace hapticd
