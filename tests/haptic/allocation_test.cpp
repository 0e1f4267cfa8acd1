// What runs at 1 kHz allocates nothing.
#include <gtest/gtest.h>

#include "haptic/haptic_step.h"
#include "haptic/histogram.h"
#include "haptic/loop.h"
#include "tests/support/contact_problems.h"
#include "tests/support/malloc_guard.h"
#include "tests/haptic/two_devices.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

struct Outcome {
  long allocations = -1, frees = -1;
  double peak = 0;           // [N]
  std::uint32_t status = 0;  // every bit that was set on the way
  bool viscous = false;      // the last tick's problem was the one with viscosity at 1 kHz
};

// A stroke through a soft sheet with everything that can happen to it on the way.
Outcome stroke(double friction, Renewal renewal) {
  Random random(11);
  SheetSettings sheet;
  sheet.friction = friction;
  const std::unique_ptr<CondensedProblem> problem = sheet_problem(random, sheet);
  problem->renewal = renewal;
  problem->instrument[0].coupling = {.stiffness = 200, .rotational_stiffness = 0.1, .damping_time = 2e-3};
  const Instrument instrument = sphere_instrument(1e-3);
  DeviceSettings device;
  device.max_force = 0.05;
  device.max_torque = 0.01;
  device.max_force_rate = 1e3;
  device.max_speed = 1;
  device.damping = 1;
  const auto state = std::make_unique<HapticState>();
  HapticOptions options;
  options.passivity_control = true;

  HapticInput input;
  input.device[0].presence.connected = true;
  Outcome out;
  const MallocGuard guard;
  for (int i = 1; i <= 1500; ++i) {
    input.now_ns = (1000 + i) * ms + (i == 700 ? 7 * ms : 0);
    input.device[0].presence.new_client = i == 1;
    input.device[0].presence.connected = i < 1200 || i > 1210;
    input.device[0].presence.conflict = i == 800;
    input.device[0].taken = i < 900 || i > 915;
    input.device[0].sample.sequence = static_cast<std::uint64_t>(i);
    input.device[0].sample.received_ns = input.now_ns;
    input.device[0].sample.enable = i != 1230;
    input.device[0].sample.pose.p = Vec3(1e-3 * std::sin(0.01 * i), 0, 0.9e-3 - 0.3e-3 * std::sin(0.02 * i));
    if (i == 850) input.device[0].sample.pose.p.x() = std::nan("");
    problem->step = static_cast<std::uint64_t>(1 + i / 20);
    problem->topology_changed = i / 20 % 7 == 0;
    problem->published_ns = i < 1000 || i > 1100 ? input.now_ns : 2000 * ms;
    const ForceSample f = haptic_step(problem.get(), instrument, device, options, input, *state);
    out.peak = std::max(out.peak, f.force.norm());
    out.status |= f.status;
  }
  out.allocations = guard.allocations();
  out.frees = guard.frees();
  return out;
}

TEST(Allocation, HapticStepAllocatesNothingWhateverHappens) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  for (const double friction : {0.0, 0.4})
    for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
      const Outcome o = stroke(friction, renewal);
      EXPECT_EQ(o.allocations, 0);
      EXPECT_EQ(o.frees, 0);
      EXPECT_GT(o.peak, 1e-3);  // it was in contact
      const std::uint32_t passed = status_disarmed | status_holding | status_ramping_down |
                                   status_ramping_up | status_problem_old | status_gap | status_rejected |
                                   status_conflict | status_blending;
      EXPECT_EQ(o.status & passed, passed);
    }
}

// The options that the daemon runs with (server/scene/scene_world.cpp): viscosity, margin, budget of sweeps.
HapticOptions daemon_options(Renewal renewal, double alarm_distance, double lag) {
  HapticOptions options;
  options.contact.linearisations = 2;
  options.contact.margin = renewal == Renewal::frozen ? 0 : 0.15 * alarm_distance;
  options.contact.coulomb.max_sweeps = 50;
  options.viscous.step = 0.02;
  options.viscous.relaxation[0] = 2e-3;
  options.viscous.lag = lag;
  options.passivity_control = true;
  return options;
}

// Every 20 ticks a step publishes; of three steps one removes something: its interim problem comes 2 ticks
// later without some samples, and its refreshes 6 and 12 ticks later with another compliance and free motion.
Outcome stroke_of_the_daemon(double friction, Renewal renewal, double lag) {
  Random random(12);
  SheetSettings sheet;
  sheet.friction = friction;
  const std::unique_ptr<CondensedProblem> whole = sheet_problem(random, sheet),
                                          cut = sheet_problem(random, sheet);
  cut->samples -= 8;
  for (CondensedProblem* p : {whole.get(), cut.get()}) {
    p->renewal = renewal;
    p->instrument[0].coupling = {.stiffness = 200, .rotational_stiffness = 0.1, .damping_time = 2e-3};
  }
  const Instrument instrument = sphere_instrument(1e-3);
  DeviceSettings device;
  device.max_force = 0.05;
  device.max_torque = 0.01;
  device.max_force_rate = 1e3;
  device.max_speed = 1;
  const HapticOptions options = daemon_options(renewal, whole->alarm_distance, lag);
  const auto state = std::make_unique<HapticState>();

  HapticInput input;
  input.device[0].presence.connected = true;
  std::uint64_t step = 0;
  const CondensedProblem* newest = whole.get();
  Outcome out;
  const MallocGuard guard;
  for (int i = 1; i <= 1500; ++i) {
    const bool removing = i / 20 % 3 == 1;
    const int after = i % 20;
    if (after == 0 || (removing && (after == 2 || after == 6 || after == 12))) {
      CondensedProblem& next = removing && after > 0 ? *cut : *whole;
      next.step = ++step;
      next.topology_changed = removing && after == 2;
      next.published_ns = (1000 + i) * ms;
      for (int n = 0; n < next.nodes; ++n) next.x_free[n].z() += after == 6 ? 1e-6 : after == 12 ? -1e-6 : 0;
      next.C() *= after == 6 ? 1.01 : after == 12 ? 1 / 1.01 : 1;
      newest = &next;
    }
    input.now_ns = (1000 + i) * ms + i % 7 * (ms / 10);
    input.period_ns = i % 5 == 0 ? ms + ms / 5 : 0;  // some ticks come late
    input.device[0].presence.new_client = i == 1;
    input.device[0].taken = true;
    input.device[0].sample.sequence = static_cast<std::uint64_t>(i);
    input.device[0].sample.received_ns = input.now_ns;
    input.device[0].sample.enable = true;
    input.device[0].sample.pose.p = Vec3(1e-3 * std::sin(0.01 * i), 0, 0.9e-3 - 0.3e-3 * std::sin(0.02 * i));
    const ForceSample f = haptic_step(newest, instrument, device, options, input, *state);
    out.peak = std::max(out.peak, f.force.norm());
    out.status |= f.status;
  }
  out.allocations = guard.allocations();
  out.frees = guard.frees();
  out.viscous = state->patch.step == newest->step;
  return out;
}

TEST(Allocation, HapticStepAllocatesNothingUnderTheDaemonsOwnOptions) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  for (const double friction : {0.0, 0.4})
    for (const Renewal renewal : {Renewal::renewed, Renewal::frozen})
      for (const double lag : {0.0, 0.15e-3}) {
        const Outcome o = stroke_of_the_daemon(friction, renewal, lag);
        EXPECT_EQ(o.allocations, 0);
        EXPECT_EQ(o.frees, 0);
        EXPECT_GT(o.peak, 1e-3);
        EXPECT_EQ(o.viscous, renewal == Renewal::renewed);
      }
}

// Two hands on one sheet; each in turn falls silent, lies, lets go, leaves and comes back.
TEST(Allocation, ATickOfTwoDevicesAllocatesNothingWhoeverComesAndGoes) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  for (const double friction : {0.0, 0.4}) {
    two_devices::Hands hands(friction);
    hands.options.passivity_control = true;
    EachInstrument<std::uint32_t> seen;
    EachInstrument<double> peak;
    int together = 0, single = 0;
    const MallocGuard guard;
    for (int i = 1; i <= 3000; ++i) {
      hands.depth[0] = 0.4e-3 * std::sin(0.013 * i);
      hands.depth[1] = 0.4e-3 * std::sin(0.011 * i);
      hands.problem->step = static_cast<std::uint64_t>(1 + i / 20);
      hands.problem->topology_changed = i / 20 % 7 == 0;
      hands.publish = i < 2500 || i > 2570;
      hands.tick([i](HapticInput& now) {
        DeviceInput& d = now.device[i / 1000 % 2];
        const int t = i % 1000;
        d.taken = t < 400 || t > 415;
        d.sample.enable = t != 500 && t != 760;
        if (t > 700 && t < 705) d.sample.pose.p.x() = std::nan("");
        d.presence.connected = t < 800 || t > 810;
        d.presence.new_client = d.presence.new_client || t == 811;
        d.presence.conflict = t == 850;
      });
      together += hands.state->solved && hands.present(0) && hands.present(1);
      single += hands.state->solved && hands.present(0) != hands.present(1);
      for (int k = 0; k < 2; ++k) {
        seen[k] |= hands.force[k].status;
        peak[k] = std::max(peak[k], hands.force[k].force.norm());
      }
    }
    EXPECT_EQ(guard.allocations(), 0);
    EXPECT_EQ(guard.frees(), 0);
    EXPECT_GT(together, 1000);
    EXPECT_GT(single, 100);
    const std::uint32_t passed = status_disarmed | status_holding | status_ramping_down | status_ramping_up |
                                 status_rejected | status_latched | status_conflict | status_blending;
    for (int k = 0; k < 2; ++k) {
      EXPECT_EQ(seen[k] & passed, passed) << k;
      EXPECT_GT(peak[k], 1e-3) << k;
    }
  }
}

TEST(Allocation, ChannelQueueAndHistogramAllocateNothing) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  Channel<CondensedProblem> channel;
  SpscQueue<ForceRecord> queue(16);
  Histogram histogram;
  ForceRecord record;
  const MallocGuard guard;
  for (int i = 0; i < 100; ++i) {
    channel.back().step = static_cast<std::uint64_t>(i);
    channel.publish();
    channel.acquire();
    queue.push(record);
    if (i % 3 == 0) queue.pop(record);
    histogram.record(i * 1000);
  }
  EXPECT_EQ(guard.allocations(), 0);
}

}  // namespace
}  // namespace hapticd
