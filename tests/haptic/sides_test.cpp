// Tissue that the two loops have on different sides of an instrument: a rod between two flaps, and a loop
// that finds back to what the simulation publishes.
#include "haptic/contact/sides.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "haptic/haptic_step.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

constexpr double alarm = 0.4e-3, radius = 0.3e-3;  // [m]
constexpr std::int64_t ms = 1'000'000;

std::unique_ptr<CondensedProblem> one_sample() {
  auto p = spring_problem(100, Vec3::Zero(), 0);
  p->alarm_distance = alarm;
  return p;
}

PatchPositions all_at(const Vec3& x) {
  PatchPositions at;
  at.fill(x);
  return at;
}

// On a sphere about the origin, `angle` round it and `above` its surface.
Vec3 round(double angle, double above) {
  return (radius + above) * Vec3(std::sin(angle), 0, -std::cos(angle));
}

bool differ(const Pose& X_a, const Vec3& a, const Pose& X_b, const Vec3& b) {
  const auto problem = one_sample();
  const Instrument ball = sphere_instrument(radius);
  return on_other_side(*problem, ball, X_a, all_at(a), X_b, all_at(b))[0];
}

// The chord between two points of a sphere, `angle` apart, is r (1 − cos(angle/2)) deep.
TEST(Sides, AWayThroughIsAnotherSide) {
  const double deep = alarm / 4, limit = 2 * std::acos(1 - deep / radius);
  EXPECT_FALSE(differ(Pose(), round(0, 0), Pose(), round(0.9 * limit, 0)));
  EXPECT_TRUE(differ(Pose(), round(0, 0), Pose(), round(1.2 * limit, 0)));
  EXPECT_TRUE(differ(Pose(), round(0, 0), Pose(), round(std::numbers::pi, 0.5e-3)));
  EXPECT_TRUE(differ(Pose(), round(0, 0.1e-3), Pose(), Vec3::Zero())) << "in the middle of it";
}

TEST(Sides, WhatIsPressedOnIsOnTheSameSide) {
  Pose moved;
  moved.p = Vec3(0, 0, -2e-3);
  EXPECT_FALSE(differ(Pose(), round(0, 0), moved, moved.p + round(0, 0)));
  EXPECT_TRUE(differ(Pose(), round(0, 0), moved, round(0, 0))) << "went through it";
}

TEST(Sides, WhoIsNotThereIsOnNone) {
  const auto problem = one_sample();
  const Instrument ball = sphere_instrument(radius);
  EXPECT_FALSE(on_other_side(*problem, ball, InstrumentPoses(), all_at(round(0, 0)), Pose(),
                             all_at(round(std::numbers::pi, 0)))[0]);
}

// A ball of 1 mm on a sheet 0.3 mm deep; in `beyond` the sheet is where the ball has it above itself.
struct Loop {
  std::unique_ptr<CondensedProblem> pressed, beyond;
  Instrument ball = sphere_instrument(1e-3);
  DeviceSettings device;
  HapticOptions options;
  HapticInput in;
  std::unique_ptr<HapticState> state = std::make_unique<HapticState>();

  explicit Loop(double friction = 0) {
    Random random(3);
    SheetSettings sheet;
    sheet.friction = friction;
    pressed = sheet_problem(random, sheet);
    pressed->step = 2;
    pressed->alarm_distance = alarm;
    pressed->instrument[0].coupling = {.stiffness = 200, .rotational_stiffness = 0.1, .damping_time = 2e-3};
    pressed->instrument[0].X_ref.p = Vec3(0, 0, 0.7e-3);
    beyond = std::make_unique<CondensedProblem>(*pressed);
    beyond->step = 1;
    for (int n = 0; n < beyond->nodes; ++n) {
      beyond->x_free[n].z() += 3e-3;
      beyond->x_now[n].z() += 3e-3;
    }
    device.max_force = 10;
    device.max_force_rate = 1e6;
    device.max_speed = 10;
    options.contact.margin = alarm;
    options.viscous.step = 20e-3;
    options.viscous.relaxation[0] = 2e-3;
    in.now_ns = 1000 * ms;
    in.device[0].presence = {.connected = true, .new_client = true};
    in.device[0].sample.enable = true;
    in.device[0].sample.pose.p = Vec3(0, 0, 0.7e-3);
  }

  ForceSample tick(CondensedProblem& problem) {
    in.now_ns += ms;
    in.device[0].taken = true;
    ++in.device[0].sample.sequence;
    in.device[0].sample.received_ns = in.now_ns;
    problem.published_ns = in.now_ns;
    const ForceSample f = haptic_step(&problem, ball, std::span(&device, 1), options, in, *state)[0];
    in.device[0].presence.new_client = false;
    return f;
  }

  ForceSample ticks(CondensedProblem& problem, int n) {
    ForceSample f;
    for (int i = 0; i < n; ++i) f = tick(problem);
    return f;
  }
};

// As the simulation ends a step: the problem from where another loop, at rest, has the patch, with that
// loop's contact. x_free knows by β/h where the patch is now (viscous_patch.h).
void publish(const Loop& simulation, const Vec3& device, CondensedProblem& problem) {
  const HapticState& s = *simulation.state;
  problem.known = s.contact.memory;
  problem.instrument[0].offset = s.contact.coupling_offset[0];
  problem.instrument[0].X_ref.p = device;
  const double by_step = 2e-3 / 20e-3;
  for (int n = 0; n < problem.nodes; ++n) {
    problem.x_now[n] = s.scratch.x[n];
    problem.x_free[n] = (problem.x_free[n] + by_step * problem.x_now[n]) / (1 + by_step);
  }
}

// One that had the sheet above its ball answers as one that began with the published problem.
TEST(Sides, TheSimulationHasTheWord) {
  Loop began(0.1), strayed(0.1);
  const double right = began.ticks(*began.pressed, 200).force.z();
  ASSERT_GT(right, 1e-3);
  publish(began, began.in.device[0].sample.pose.p, *strayed.pressed);
  ASSERT_EQ(strayed.ticks(*strayed.beyond, 200).force.norm(), 0);
  const ForceSample first = strayed.tick(*strayed.pressed);
  EXPECT_TRUE(first.status & status_contact_lost);
  EXPECT_TRUE(first.status & status_blending);
  EXPECT_LT(first.force.norm(), 0.3 * right);
  const ForceSample then = strayed.tick(*strayed.pressed);
  EXPECT_FALSE(then.status & status_contact_lost);
  EXPECT_NEAR(strayed.ticks(*strayed.pressed, 100).force.z(), right, 1e-3 * right);
}

// Of a problem that came without the simulation's contact, it begins from no forces.
TEST(Sides, WithoutItsContactItBeginsFromNone) {
  Loop began, strayed;
  const double right = began.ticks(*began.pressed, 200).force.z();
  strayed.ticks(*strayed.beyond, 200);
  EXPECT_TRUE(strayed.tick(*strayed.pressed).status & status_contact_lost);
  EXPECT_NEAR(strayed.ticks(*strayed.pressed, 100).force.z(), right, 1e-3 * right);
}

// Within a problem, too: a ball whose hand goes on by more than its radius in a tick has its centre beyond
// the sheet, and no row holds what is in it. It is met where the problem was made, and then on the way from
// there.
TEST(Sides, WhatASolveLosesIsMetAnewInThatTick) {
  Loop loop(0.1);
  const double before = loop.ticks(*loop.pressed, 50).force.z();
  ASSERT_GT(before, 1e-3);
  loop.in.device[0].sample.pose.p.z() -= 1.5e-3;
  const ForceSample f = loop.tick(*loop.pressed);
  EXPECT_TRUE(f.status & status_contact_lost);
  EXPECT_LT(f.penetration, 1e-6);
  EXPECT_GT(loop.ticks(*loop.pressed, 100).force.z(), 2 * before);
}

// A ball that is drawn sideways by less than it takes to slip is held by where it first touched.
TEST(Sides, WhatTheSimulationsContactHoldsIsHeld) {
  Loop simulation(0.3), strayed(0.3);
  simulation.ticks(*simulation.pressed, 200);
  simulation.in.device[0].sample.pose.p.x() += 20e-6;
  const Vec3 right = simulation.ticks(*simulation.pressed, 200).force;
  ASSERT_GT(std::abs(right.x()), 0.05 * right.z());
  ASSERT_LT(std::abs(right.x()), 0.25 * right.z());

  publish(simulation, simulation.in.device[0].sample.pose.p, *strayed.pressed);
  strayed.ticks(*strayed.beyond, 200);
  strayed.in.device[0].sample.pose = simulation.in.device[0].sample.pose;
  EXPECT_TRUE(strayed.tick(*strayed.pressed).status & status_contact_lost);
  EXPECT_LT((strayed.ticks(*strayed.pressed, 100).force - right).norm(), 1e-3 * right.norm());
}

// A solver that may hardly do anything is enough where the simulation has solved it.
TEST(Sides, WhatTheSimulationSolvedIsSolved) {
  for (const bool published : {true, false}) {
    Loop simulation(0.3), strayed(0.3);
    simulation.ticks(*simulation.pressed, 400);
    publish(simulation, simulation.in.device[0].sample.pose.p, *strayed.pressed);
    if (!published) strayed.pressed->known.count = 0;
    strayed.ticks(*strayed.beyond, 200);
    strayed.options.contact.coulomb.max_sweeps = strayed.options.contact.coulomb.max_newton = 1;
    EXPECT_TRUE(strayed.tick(*strayed.pressed).status & status_contact_lost);
    EXPECT_EQ(strayed.state->solution.status == SolveStatus::solved, published);
  }
}

// What the device went on by since the problem was made is made up for in ticks: an eighth of it in each, and
// no less than 20 um, with the first one's force that of the simulation's own solve.
TEST(Sides, TheWayFromThereIsMadeUpFor) {
  Loop simulation, strayed, right;
  const Vec3 made = simulation.in.device[0].sample.pose.p, device = made - Vec3(0, 0, 0.32e-3);
  const double first = simulation.ticks(*simulation.pressed, 200).force.z();
  publish(simulation, made, *strayed.pressed);
  right.in.device[0].sample.pose.p = strayed.in.device[0].sample.pose.p = device;
  const double last = right.ticks(*right.pressed, 200).force.z();
  ASSERT_GT(last, 1.5 * first);

  strayed.ticks(*strayed.beyond, 200);
  double behind = 0.32e-3;
  strayed.tick(*strayed.pressed);
  EXPECT_NEAR(strayed.state->solution.wrench[0][2], first, 1e-6 * first);
  for (int i = 0; i < 14; ++i) {
    EXPECT_NEAR(strayed.state->behind[0].head<3>().norm(), behind, 1e-12) << i;
    behind = std::max(0.0, behind - std::max(behind / 8, 20e-6));
    strayed.tick(*strayed.pressed);
  }
  EXPECT_EQ(strayed.state->behind[0].norm(), 0);
  EXPECT_NEAR(strayed.ticks(*strayed.pressed, 200).force.z(), last, 1e-6 * last);
}

}  // namespace
}  // namespace hapticd
