#include "haptic/tuning.h"

#include <memory>

#include <gtest/gtest.h>

#include "haptic/haptic_step.h"
#include "tests/haptic/wall.h"
#include "tests/support/malloc_guard.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr double period = 1e-3;
constexpr std::int64_t ms = 1'000'000;

DeviceSettings touch() {
  DeviceSettings d;
  d.max_force = 3.3;
  d.max_force_rate = 200;
  d.max_speed = 2;
  d.workspace_radius = 0.075;
  d.damping = 4;
  return d;
}

TEST(Tuning, LimitsMayFallAndComeBackButNeverRise) {
  const DeviceTuning started = tuning_of(touch());
  DeviceTuning wanted = started;
  wanted.max_force = 2;
  wanted.max_speed = 5;
  wanted.max_force_rate = 1e4;
  const DeviceTuning given = clamped(wanted, started, 400, 400);
  EXPECT_EQ(given.max_force, 2);
  EXPECT_EQ(given.max_speed, 2);
  EXPECT_EQ(given.max_force_rate, 200);
  EXPECT_EQ(clamped(started, started, 400, 400), started);
}

// A hand feels at most K_vc · position_scale · force_scale: 200 · 1 · 2 is all that 400 N/m allow.
TEST(Tuning, ScalesKeepWhatTheDeviceDisplaysStably) {
  const DeviceTuning started = tuning_of(touch());
  DeviceTuning wanted = started;
  wanted.force_scale = 10;
  EXPECT_DOUBLE_EQ(clamped(wanted, started, 200, 400).force_scale, 2);
  wanted.force_scale = 1.5;
  EXPECT_EQ(clamped(wanted, started, 200, 400).force_scale, 1.5);
  // A scene that began beyond the device's figure may keep what it has, and no more.
  wanted.force_scale = 1;
  EXPECT_EQ(clamped(wanted, started, 4000, 400).force_scale, 1);
  wanted.force_scale = 1.1;
  EXPECT_EQ(clamped(wanted, started, 4000, 400).force_scale, 1);
}

TEST(Tuning, TheRampIsLinearAndEndsExactlyThereAfterASecond) {
  DeviceSettings d = touch();
  DeviceTuning target = tuning_of(d);
  target.force_scale = 3;
  target.max_force = 1.3;
  TuningRamp ramp;
  start_ramp(ramp, target);
  const MallocGuard guard;
  for (int tick = 1; tick <= 1000; ++tick) {
    advance(ramp, d, period);
    EXPECT_NEAR(d.force_scale, 1 + 2 * tick / 1000.0, 1e-12);
    EXPECT_NEAR(d.max_force, 3.3 - 2 * tick / 1000.0, 1e-12);
  }
  if (MallocGuard::available()) {
    EXPECT_EQ(guard.allocations(), 0);
  }
  EXPECT_EQ(tuning_of(d), target);
  advance(ramp, d, period);
  EXPECT_EQ(tuning_of(d), target);
}

// Held in the wall at a depth whose force is F: doubling the force scale doubles F, and no tick of it changes
// the force by more than F / 1000.
TEST(Tuning, AChangeOfScaleMakesNoForceStep) {
  const Instrument instrument = wall::instrument();
  const auto problem = std::make_unique<CondensedProblem>();
  const auto state = std::make_unique<HapticState>();
  DeviceSettings d = touch();
  constexpr double depth = 0.1e-3;
  const double F = depth * wall::stiffness;
  HapticOptions options;
  options.watchdog.period_ns = ms;
  TuningRamp ramp;
  double last = 0, first = 0, largest = 0;
  for (int tick = 1; tick <= 2500; ++tick) {
    HapticInput input;
    input.now_ns = 1'000'000'000 + tick * ms;
    wall::make(*problem, static_cast<std::uint64_t>(tick), input.now_ns);
    input.device[0].presence = {.connected = true, .new_client = tick == 1};
    input.device[0].taken = true;
    input.device[0].sample.sequence = static_cast<std::uint64_t>(tick);
    input.device[0].sample.received_ns = input.now_ns;
    input.device[0].sample.enable = true;
    input.device[0].sample.pose.p = Vec3(0, 0, wall::radius - depth);
    if (tick == 1000) {
      DeviceTuning twice = tuning_of(d);
      twice.force_scale = 2;
      start_ramp(ramp, twice);
      first = last;
    }
    advance(ramp, d, period);
    const double force = haptic_step(problem.get(), instrument, d, options, input, *state).force.z();
    if (tick >= 1000) largest = std::max(largest, std::abs(force - last));
    last = force;
  }
  EXPECT_NEAR(first, F, wall::tolerance * F);
  EXPECT_NEAR(last, 2 * first, 1e-9 * F);
  EXPECT_GT(largest, 0.9 * F / 1000);
  EXPECT_LT(largest, 1.01 * F / 1000);
}

}  // namespace
}  // namespace hapticd
