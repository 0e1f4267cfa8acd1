// A tick takes the newest problem, and what its last solve was of stays as it was published meanwhile.
#include "haptic/haptic_tick.h"

#include <gtest/gtest.h>

#include <limits>
#include <utility>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr double radius = 3e-3;

struct TickOnASheet : testing::Test {
  const Instrument tip = sphere_instrument(radius);
  Channel<CondensedProblem> problems;
  std::unique_ptr<CondensedProblem> sheet;
  std::unique_ptr<HapticTick> tick;
  HapticInput in;

  TickOnASheet() {
    Random random(1);
    sheet = sheet_problem(random, {});
    sheet->instrument[0].coupling = {.stiffness = 200, .rotational_stiffness = 0.1};
    DeviceSettings device;
    device.max_force = 3;
    device.max_force_rate = 1e4;
    device.max_speed = 10;
    HapticOptions options;
    options.viscous.step = 20e-3;
    options.viscous.relaxation[0] = 2e-3;
    tick = std::make_unique<HapticTick>(Instruments(tip), device, options, problems);
    in.now_ns = 1000 * ms;
    in.device[0].taken = in.device[0].sample.enable = true;
    in.device[0].presence.connected = in.device[0].presence.new_client = true;
    in.device[0].sample.pose.p = Vec3(0, 0, radius - 0.2e-3);
  }
  // As the simulation does: over whatever the slot had.
  void publish(std::uint64_t step, bool removal = false) {
    CondensedProblem& slot = problems.back();
    slot.C_pp.fill(std::numeric_limits<double>::quiet_NaN());
    copy_in_use(*sheet, slot);
    slot.step = step;
    slot.topology_changed = removal;
    slot.published_ns = in.now_ns;
    problems.publish();
  }
  ForceSample run() {
    in.now_ns += ms;
    in.device[0].sample.received_ns = in.now_ns;
    ++in.device[0].sample.sequence;
    const ForceSample f = tick->run(in)[0];
    in.device[0].presence.new_client = false;
    return f;
  }
  // In contact with problem 1, and so for long.
  ForceSample press() {
    ForceSample f;
    for (int i = 0; i < 400; ++i) {
      if (i % 20 == 0) publish(1);
      f = run();
    }
    return f;
  }
};

TEST_F(TickOnASheet, WhatTheLastSolveWasOfIsKept) {
  const double pressed = press().force.z();
  EXPECT_GT(pressed, 1e-3);
  const ViscousPatch& patch = tick->state().patch;
  EXPECT_EQ(patch.problem.lender, tick->problem());
  for (std::uint64_t step = 2; step < 9; ++step) {
    publish(step, step == 8);
    if (step != 5) tick->newest();
    ASSERT_NE(patch.problem.lender, tick->problem());
    EXPECT_EQ(patch.problem.lender->step, 1u) << step;
    EXPECT_EQ(patch.problem.C(), std::as_const(*sheet).C()) << step;
  }
  // A removal: until it was published the problem before is pressed on.
  const ForceSample f = run();
  EXPECT_EQ(f.step, 8u);
  EXPECT_NEAR(f.force.z(), pressed, 1e-3 * pressed);
  EXPECT_EQ(patch.problem.lender, tick->problem());
}

}  // namespace
}  // namespace hapticd
