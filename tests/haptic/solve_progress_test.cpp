// A contact solve that never has time enough: what it reached serves the next tick, and is felt.
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>

#include "haptic/haptic_step.h"
#include "tests/support/contact_problems.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

// A flat tip on a sheet, up to a hundred samples sticking at once: hyperstatic, and dear to factor.
struct FlatTip {
  std::unique_ptr<CondensedProblem> problem;
  Instrument instrument;
  DeviceSettings device;
  HapticOptions options;
  std::unique_ptr<HapticState> state = std::make_unique<HapticState>();
  HapticInput input;
  int tick_number = 0;

  explicit FlatTip(std::uint64_t seed) {
    Random random(seed);
    SheetSettings sheet;
    sheet.nodes = 7;
    sheet.per_triangle = 4;
    sheet.friction = 0.5;
    problem = sheet_problem(random, sheet);
    problem->instrument[0].coupling = {.stiffness = 200, .rotational_stiffness = 0.1, .damping_time = 2e-3};
    Primitive tip;
    tip.name = "tip";
    tip.shape = Shape::cylinder;
    tip.radius = uniform(random, 1.5e-3, 3.5e-3);
    tip.half_length = 5e-3;
    tip.placement.p = Vec3(0, 0, 5e-3);
    instrument.primitives = {tip};
    device.max_force = 10;
    device.max_force_rate = 1e6;
    device.max_speed = 10;
    input.device[0].presence.connected = true;
    input.device[0].presence.new_client = true;
  }

  ForceSample tick(const Pose& X) {
    ++tick_number;
    input.now_ns = (1000 + tick_number) * ms;
    input.device[0].taken = true;
    input.device[0].sample.sequence = static_cast<std::uint64_t>(tick_number);
    input.device[0].sample.received_ns = input.now_ns;
    input.device[0].sample.enable = true;
    input.device[0].sample.pose = X;
    problem->published_ns = input.now_ns;
    const ForceSample force = haptic_step(problem.get(), instrument, device, options, input, *state);
    input.device[0].presence.new_client = false;
    return force;
  }
};

using Stroke = std::array<double, 6>;

Stroke stroke(int seed) {
  Random random(100 + seed);
  const auto between = [&](double low, double high) { return uniform(random, low, high); };
  return {between(-0.5e-3, 0.5e-3), between(-0.5e-3, 0.5e-3), between(0.2e-3, 0.6e-3),
          between(-0.03, 0.03),     between(-0.03, 0.03),     between(1, 4)};
}

constexpr int ticks = 600;

// Pressed, drawn to and fro, let go; a little tilted.
Pose at(const Stroke& stroke, int tick) {
  const double s = static_cast<double>(tick) / ticks;
  const double press = std::min(1.0, 4 * std::pow(std::sin(std::numbers::pi * s), 2));
  Pose X;
  X.p = Vec3(stroke[0], stroke[1], 0.05e-3 - (stroke[2] + 0.05e-3) * press);
  X.p.x() += 0.5e-3 * std::sin(2 * std::numbers::pi * stroke[5] * s);
  X.q = Quat(Eigen::AngleAxisd(stroke[3], Vec3::UnitX()) * Eigen::AngleAxisd(stroke[4], Vec3::UnitY()));
  return X;
}

struct Felt {
  std::vector<Vec3> force;
  int longest = 0;   // run of ticks whose solve was not usable
  int unusable = 0;  // ticks
};

// sideways: of where the stroke is [m].
Felt feel(int seed, const CoulombOptions& coulomb, double sideways = 0) {
  FlatTip tip(static_cast<std::uint64_t>(seed + 1));
  tip.options.contact.coulomb = coulomb;
  Felt felt;
  int run = 0;
  const Stroke path = stroke(seed);
  for (int t = -120; t < ticks; ++t) {
    Pose X;
    X.p.z() = 1e-3;
    if (t >= 0) X = at(path, t);
    X.p.x() += sideways;
    const ForceSample f = tip.tick(X);
    if (t < 0) continue;
    felt.force.push_back(f.force);
    const bool unusable = (f.status & status_solver_cap) && f.residual > tip.options.usable_residual;
    felt.unusable += unusable;
    run = unusable ? run + 1 : 0;
    felt.longest = std::max(felt.longest, run);
  }
  return felt;
}

double rms_error(const Felt& felt, const Felt& reference) {
  double error = 0, force = 0;
  for (std::size_t t = 0; t < felt.force.size(); ++t) {
    error += (felt.force[t] - reference.force[t]).squaredNorm();
    force += reference.force[t].squaredNorm();
  }
  return std::sqrt(error / force);
}

// Two sweeps, or six and two steps of Newton, never enough for a hundred contacts from where they were:
// without progress from tick to tick there is no force at all while pressed. What friction holds depends on
// its past; the reference is one that a micrometre sideways does not change.
TEST(SolveProgress, AFlatTipIsFeltThoughNoSolveEnds) {
  for (const int seed : {0, 1, 4}) {
    const Felt full = feel(seed, {});
    ASSERT_EQ(full.unusable, 0);
    EXPECT_LT(rms_error(feel(seed, {}, 1e-6), full), 0.02) << seed;
    CoulombOptions two, six;
    two.max_sweeps = 2;
    two.max_newton = 0;
    six.max_sweeps = 6;
    six.max_newton = 2;
    for (const CoulombOptions& little : {two, six}) {
      const Felt felt = feel(seed, little);
      EXPECT_LE(felt.longest, 10) << seed;
      EXPECT_LT(rms_error(felt, full), 0.05) << seed;
    }
  }
}

// A deadline by a clock that goes on by a microsecond each time it is asked.
struct CountingClock {
  std::int64_t left_ns;
  Deadline deadline() {
    return {[](const void* clock) noexcept {
              return static_cast<CountingClock*>(const_cast<void*>(clock))->left_ns -= 1000;
            },
            this};
  }
};

// A stiff node between soft ones: C ← S C S.
void scale_badly(std::uint64_t seed, CondensedProblem& problem) {
  Random random(seed);
  auto C = problem.C();
  for (int n = 0; n < problem.nodes; ++n) {
    const double s = std::pow(10, uniform(random, -6, 0));
    C.middleRows<3>(3 * n) *= s;
    C.middleCols<3>(3 * n) *= s;
  }
}

// A linearisation about what an unfinished solve left would be of any place, and its solution, solved or not,
// any force. Whatever time there is: what is called solved is the force that unlimited time gives, to 1 % of
// the peak.
TEST(SolveProgress, WhatIsCalledSolvedIsSolvedHere) {
  int solved = 0, late = 0;
  for (const int seed : {0, 1, 2, 3}) {
    FlatTip tip(static_cast<std::uint64_t>(seed + 1));
    scale_badly(static_cast<std::uint64_t>(seed + 50), *tip.problem);
    const Stroke path = stroke(seed);
    double peak = 0;
    for (int t = -120; t < 500; ++t) {
      Pose X;
      X.p.z() = 1e-3;
      if (t >= 0) X = at(path, t);
      if (t < 100 || t % 10 > 0) {
        peak = std::max(peak, tip.tick(X).force.norm());
        continue;
      }
      const HapticState before = *tip.state;
      const int tick_number = tip.tick_number;
      const Vec3 force = tip.tick(X).force;
      const HapticState after = *tip.state;
      peak = std::max(peak, force.norm());
      for (std::int64_t us = 6; us <= 96; us += 6) {
        *tip.state = before;
        tip.tick_number = tick_number;
        CountingClock clock{1000 * us};
        tip.input.deadline = clock.deadline();
        const ForceSample f = tip.tick(X);
        tip.input.deadline = {};
        ++(f.status & status_solver_cap ? late : solved);
        if (!(f.status & status_solver_cap)) {
          EXPECT_LT((f.force - force).norm(), 0.01 * peak) << seed << ", tick " << t << ", " << us << " µs";
        }
      }
      *tip.state = after;
    }
  }
  EXPECT_GT(solved, 1000);
  EXPECT_GT(late, 500);
}

}  // namespace
}  // namespace hapticd
