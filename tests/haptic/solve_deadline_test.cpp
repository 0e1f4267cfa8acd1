// A contact solve that runs out of time: the device feels the best iterate, or the last good force, never
// more.
#include <gtest/gtest.h>

#include "haptic/haptic_step.h"
#include "tests/support/contact_problems.h"
#include "tests/support/malloc_guard.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

// A sphere pressed into a soft sheet, tick by tick, with a clock of its own.
class Pressed {
 public:
  explicit Pressed(double friction) {
    Random random(5);
    SheetSettings sheet;
    sheet.nodes = 7;
    sheet.per_triangle = 3;
    sheet.friction = friction;
    problem_ = sheet_problem(random, sheet);
    problem_->instrument[0].coupling = {.stiffness = 200, .rotational_stiffness = 0.1, .damping_time = 2e-3};
    device_.max_force = 10;
    device_.max_force_rate = 1e6;
    device_.max_speed = 10;
    input_.device[0].presence.connected = true;
    input_.device[0].presence.new_client = true;
  }

  // A clock that shows `left_ns` and loses `per_look_ns` each time it is asked.
  ForceSample tick(double depth, std::int64_t left_ns, std::int64_t per_look_ns = 0) {
    clock_ = {left_ns, per_look_ns, 0};
    input_.deadline.clock = &clock_;
    input_.deadline.left_ns = [](const void* c) noexcept {
      auto* clock = static_cast<const Clock*>(c);
      ++clock->looks;
      return clock->left -= clock->per_look;
    };
    ++tick_;
    input_.now_ns = (1000 + tick_) * ms;
    input_.device[0].taken = true;
    input_.device[0].sample.sequence = static_cast<std::uint64_t>(tick_);
    input_.device[0].sample.received_ns = input_.now_ns;
    input_.device[0].sample.enable = true;
    input_.device[0].sample.pose.p = Vec3(0.3e-3 + 2e-6 * tick_, 0, 4e-3 - depth);
    problem_->published_ns = input_.now_ns;
    const ForceSample force = haptic_step(problem_.get(), instrument_, device_, options, input_, *state);
    input_.device[0].presence.new_client = false;
    return force;
  }

  // Through the ramp of arming, 0.3 mm deep.
  ForceSample settled() {
    ForceSample force;
    for (int i = 0; i < 200; ++i) force = tick(0.3e-3, 1000 * ms);
    return force;
  }

  // Another problem, made a millimetre above, of which nothing is remembered: how often its tick asks.
  int looks_of_an_outrun_problem(std::int64_t left_ns) {
    problem_->step += 1;
    problem_->instrument[0].X_ref.p = Vec3(0, 0, 5e-3);
    state->contact.memory.count = 0;
    tick(0.3e-3, left_ns);
    return clock_.looks;
  }

  HapticOptions options;
  std::unique_ptr<HapticState> state = std::make_unique<HapticState>();

 private:
  struct Clock {
    mutable std::int64_t left = 0;
    std::int64_t per_look = 0;
    mutable int looks = 0;
  };
  std::unique_ptr<CondensedProblem> problem_;
  Instrument instrument_ = sphere_instrument(4e-3);
  DeviceSettings device_;
  HapticInput input_;
  Clock clock_;
  int tick_ = 0;
};

TEST(SolveDeadline, WithTimeThereIsNoCap) {
  for (const double friction : {0.0, 0.4}) {
    Pressed p(friction);
    const ForceSample f = p.settled();
    EXPECT_GT(f.force.norm(), 1e-3);
    EXPECT_EQ(f.solver_caps, 0u);
    EXPECT_EQ(f.status & status_solver_cap, 0u);
    EXPECT_GT(f.active, 0u);
    EXPECT_LT(f.residual, 1e-7);
  }
}

// Each part of the way costs rows and W, time or not.
TEST(SolveDeadline, AWayThatThereIsNoTimeForIsNotGone) {
  Pressed p(0.4);
  p.options.contact.margin = 1e-4;
  p.settled();
  EXPECT_LT(p.looks_of_an_outrun_problem(0), 25);
  EXPECT_GT(p.looks_of_an_outrun_problem(1000 * ms), 100);
}

// No time at all, while the hand goes deeper: the last good force, for 10 ms, then fading to zero in 90.
TEST(SolveDeadline, WithoutTimeTheLastGoodForceIsHeldThenFades) {
  Pressed p(0.4);
  p.options.usable_residual = 1e-9;
  const ForceSample last = p.settled();
  const Vec3 good = last.force;
  double before = good.norm();
  for (int i = 1; i <= 150; ++i) {
    const ForceSample f = p.tick(0.3e-3 + 4e-6 * i, 0);
    EXPECT_EQ(f.penetration, last.penetration) << "no iterate moves what is held";
    EXPECT_NE(f.status & status_solver_cap, 0u);
    EXPECT_EQ(f.solver_caps, static_cast<std::uint32_t>(i));
    EXPECT_LE(f.force.norm(), before * (1 + 1e-12));
    if (i <= 10) {
      EXPECT_NEAR((f.force - good).norm(), 0, 1e-9 * good.norm());
    }
    if (i > 100) {
      EXPECT_EQ(f.force.norm(), 0);
    }
    before = f.force.norm();
  }
  const ForceSample again = p.tick(0.3e-3, 1000 * ms);
  EXPECT_EQ(again.status & status_solver_cap, 0u);
  EXPECT_GT(again.force.norm(), 0.5 * good.norm());
}

// Time may end a solve whose residual is small and that leaves tissue inside. It is not called solved.
TEST(SolveDeadline, WhatEndsTooDeepIsNotCalledSolved) {
  constexpr double too_deep = 1e-6;
  int deep = 0, solved = 0;
  for (std::int64_t us = 0; us < 60; ++us) {
    Pressed p(0.0);
    p.options.contact.linearisations = 1;
    p.options.contact.too_deep = too_deep;
    p.settled();
    const ForceSample f = p.tick(1.6e-3, 1000 * us, 1000);
    const bool late = (f.status & status_solver_cap) != 0;
    solved += !late;
    deep += late && f.residual < 1e-7 && p.state->solution.penetration > too_deep;
    EXPECT_TRUE(late || p.state->solution.penetration <= too_deep) << us;
  }
  EXPECT_GT(deep, 0);
  EXPECT_GT(solved, 0);
}

// … nor gone on from: force and tissue stay as they were, for five ticks; then it is the truth there is.
TEST(SolveDeadline, ThrownTissueIsHeldForAWhile) {
  for (const double friction : {0.0, 0.4}) {
    Pressed p(friction);
    p.options.usable_residual = 1;
    p.options.contact.too_deep = 2e-6;
    const ForceSample last = p.settled();
    ASSERT_LT(last.penetration, 2e-6);
    for (int i = 1; i <= 5; ++i) {
      const ForceSample f = p.tick(0.8e-3, 0);
      EXPECT_NE(f.status & status_solver_cap, 0u);
      EXPECT_NEAR((f.force - last.force).norm(), 0, 1e-9 * last.force.norm()) << i;
      EXPECT_EQ(f.penetration, last.penetration);
    }
    EXPECT_GT(p.tick(0.8e-3, 0).penetration, 2e-6);
    const ForceSample enough = p.tick(0.8e-3, 1000 * ms);
    EXPECT_LT(enough.penetration, 2e-6);
    EXPECT_GT(enough.force.norm(), 1.5 * last.force.norm());
  }
}

// Without friction the last active set is right at once; only the second linearisation is left out.
TEST(SolveDeadline, WithoutFrictionTheWarmAnswerNeedsNoTime) {
  Pressed late(0.0), enough(0.0);
  late.settled();
  enough.settled();
  for (int i = 1; i <= 50; ++i) {
    const double depth = 0.3e-3 + 1e-6 * i;
    const ForceSample a = late.tick(depth, 0), b = enough.tick(depth, 1000 * ms);
    EXPECT_NE(a.status & status_solver_cap, 0u);
    EXPECT_LT((a.force - b.force).norm(), 0.02 * b.force.norm()) << i;
  }
}

// Now and then little time: an answer near the right one, and the right one as soon as there is time.
TEST(SolveDeadline, LittleTimeGivesTheBestIterate) {
  Pressed little(0.4), enough(0.4);
  little.settled();
  enough.settled();
  int capped = 0;
  for (int i = 1; i <= 100; ++i) {
    const double depth = 0.3e-3 + 1e-6 * i;
    const ForceSample a = little.tick(depth, i % 5 == 0 ? 5'000 : 1000 * ms, 1'000),
                      b = enough.tick(depth, 1000 * ms);
    capped += (a.status & status_solver_cap) != 0;
    EXPECT_LT((a.force - b.force).norm(), 0.1 * b.force.norm()) << i;
  }
  EXPECT_GT(capped, 10);
}

TEST(SolveDeadline, AllocatesNothing) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  for (const double friction : {0.0, 0.4}) {
    Pressed p(friction);
    p.settled();
    const MallocGuard guard;
    for (int i = 1; i <= 200; ++i) p.tick(0.3e-3 + 2e-6 * i, 1000 * (i % 40), 500);
    EXPECT_EQ(guard.allocations(), 0);
    EXPECT_EQ(guard.frees(), 0);
  }
}

}  // namespace
}  // namespace hapticd
