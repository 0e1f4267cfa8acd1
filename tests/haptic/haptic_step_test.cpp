#include "haptic/haptic_step.h"

#include <limits>
#include <memory>
#include <utility>

#include <gtest/gtest.h>

#include "tests/haptic/wall.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr double depth = 0.2e-3;  // scene [m]

// A device over the wall: a tenth of its motion and five times its force.
struct HapticStep : testing::Test {
  DeviceSettings device;
  Instrument instrument = wall::instrument();
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  HapticOptions options;
  std::unique_ptr<HapticState> state = std::make_unique<HapticState>();
  std::int64_t now = 1000 * ms;
  std::uint64_t sequence = 0;
  double height = wall::radius - depth;  // of the tip's centre in the scene
  bool publish = true;                   // the simulation lives

  HapticStep() {
    device.max_force = 3;
    device.max_torque = 0.1;
    device.max_force_rate = 1e4;
    device.max_speed = 1;
    device.damping = 4;
    device.position_scale = 0.1;
    device.force_scale = 5;
    wall::make(*problem, 1, now);
  }
  HapticInput input(bool taken = true) {
    now += ms;
    if (publish) problem->published_ns = now;
    HapticInput in;
    in.now_ns = now;
    in.device[0].presence.connected = true;
    in.device[0].presence.new_client = sequence == 0;
    in.device[0].taken = taken;
    if (taken) in.device[0].sample.sequence = ++sequence;
    in.device[0].sample.received_ns = now;
    in.device[0].sample.enable = true;
    in.device[0].sample.pose.p = device.frame.conjugate() * Vec3(0, 0, height) / device.position_scale;
    return in;
  }
  ForceSample tick(const HapticInput& in) {
    return haptic_step(problem.get(), instrument, device, options, in, *state);
  }
  ForceSample tick(bool taken = true) { return tick(input(taken)); }
  // Three damped nodes under the tip in the wall's place, each on a spring of its own.
  void soften() {
    options.viscous.step = 0.02;
    options.viscous.relaxation[0] = 2e-3;
    problem->nodes = 3;
    const Vec3 corner[] = {{-1e-3, -1e-3, 0}, {1e-3, -1e-3, 0}, {0, 2e-3, 0}};
    for (int n = 0; n < 3; ++n) {
      problem->x_free[n] = problem->x_now[n] = corner[n];
      problem->sample[0].node[n] = n;
      problem->sample[0].weight[n] = 1.0 / 3;
    }
    problem->C().setIdentity();
    problem->C() *= 1e-3;
  }
  ForceSample settle() {
    for (int i = 0; i < 120; ++i) tick();
    return tick();
  }
};

constexpr double answer = 5 * wall::stiffness * depth;  // force_scale · K · d [N]

TEST_F(HapticStep, WallPushesBackWithStiffnessTimesDepthThroughTheScales) {
  const ForceSample f = settle();
  EXPECT_EQ(f.status, 0u);
  EXPECT_NEAR(f.force.z(), answer, wall::tolerance * answer);
  EXPECT_LT(f.force.head<2>().norm(), 1e-9);
  EXPECT_EQ(f.active, 1u);
  EXPECT_EQ(f.echo_sequence, sequence);
  EXPECT_TRUE(f.answers);
  EXPECT_EQ(f.step, 1u);
}

TEST_F(HapticStep, ForceComesInTheDevicesAxes) {
  device.frame = Quat(Eigen::AngleAxisd(M_PI / 2, Vec3::UnitX()));  // scene z is the device's y
  const ForceSample f = settle();
  EXPECT_NEAR(f.force.y(), answer, wall::tolerance * answer);
  EXPECT_NEAR(f.force.z(), 0, 1e-9);
}

TEST_F(HapticStep, NoContactIsExactlyZero) {
  height = wall::radius + 0.1e-3;  // within the alarm distance: a row, but no force
  const ForceSample f = settle();
  EXPECT_EQ(f.status, 0u);
  EXPECT_EQ(f.force, Vec3::Zero());
  EXPECT_EQ(f.torque, Vec3::Zero());
  EXPECT_EQ(f.active, 0u);
}

TEST_F(HapticStep, ArmingInsideTheTissueRampsUpFromZero) {
  double last = 0;
  for (int i = 1; i <= 90; ++i) {
    const ForceSample f = tick();
    EXPECT_NEAR(f.force.z(), 0.01 * (i - 1) * answer, 0.011 * answer);
    EXPECT_GE(f.force.z(), last);
    last = f.force.z();
  }
}

TEST_F(HapticStep, ClientGoneIsExactlyZeroInTheSameTick) {
  settle();
  HapticInput in = input(false);
  in.device[0].presence.connected = false;
  const ForceSample f = tick(in);
  EXPECT_EQ(f.force, Vec3::Zero());
  EXPECT_EQ(f.torque, Vec3::Zero());
  EXPECT_EQ(f.status, status_disarmed);
}

TEST_F(HapticStep, LostStatesHoldTheForceThenRampItToZero) {
  const Vec3 before = settle().force;
  for (int age = 1; age <= 9; ++age) EXPECT_LT((tick(false).force - before).norm(), 1e-9) << age;
  for (int age = 10; age <= 13; ++age)
    EXPECT_LT((tick(false).force - (1 - 0.2 * (age - 9)) * before).norm(), 1e-9) << age;
  EXPECT_LT(tick(false).force.norm(), 1e-12);
}

// −b v, 2 N at half a metre a second; and no more than contact was when the problem came last.
TEST_F(HapticStep, OldProblemIsDampingOnly) {
  device.force_scale = 50;
  for (const double pressed : {2.8, 0.5, 0.0}) {
    state = std::make_unique<HapticState>();
    sequence = 0;
    publish = true;
    height = wall::radius - pressed / (50 * wall::stiffness) + (pressed > 0 ? 0 : 1e-3);
    ASSERT_NEAR(settle().force.z(), pressed, wall::tolerance * pressed);
    publish = false;
    ForceSample f;
    for (int i = 0; i < 70; ++i) f = tick();
    EXPECT_NEAR(f.force.z(), 0, 1e-9);
    for (int i = 0; i < 30; ++i) {
      height += 0.05e-3;  // 0.05 m/s in the scene, 0.5 m/s at the device
      f = tick();
    }
    EXPECT_EQ(f.status, status_problem_old);
    EXPECT_NEAR(f.force.z(), -std::min(4 * 0.5, pressed), 0.01 * pressed + 1e-12);
    for (int i = 0; i < 110; ++i) f = tick();
    EXPECT_EQ(f.status, status_problem_lost);
    EXPECT_EQ(f.force, Vec3::Zero());
  }
}

TEST_F(HapticStep, RemovalIsBlendedOverFiveTicksAndAnOrdinarySwapIsDirect) {
  options.thinning_time = 2e-3;
  const double before = settle().force.z();
  const double sunk = 0.05e-3, after = before - 5 * wall::stiffness * sunk;
  wall::make(*problem, 2, now, -sunk);
  problem->topology_changed = true;
  for (int i = 0; i < 5; ++i) {
    const ForceSample f = tick();
    EXPECT_NEAR(f.force.z(), after + (before - after) * (1 - (i + 1) / 6.0), wall::tolerance * before);
    EXPECT_EQ(f.status, status_blending);
  }
  EXPECT_NEAR(tick().force.z(), after, wall::tolerance * before);
  wall::make(*problem, 3, now, 0);
  const ForceSample f = tick();
  EXPECT_NEAR(f.force.z(), before, 1e-6);
  EXPECT_EQ(f.status, 0u);
}

// What a problem of less tissue makes of the same pose goes over within thinning_time, whether some of it went
// at last or not; nothing is said of it.
TEST_F(HapticStep, WhereTissueBecameLessASwapIsSmoothed) {
  options.thinning_time = 2e-3;
  double before = settle().force.z();
  const double sunk = 0.02e-3;
  for (const bool went : {false, true}) {
    const double after = before - 5 * wall::stiffness * sunk;
    wall::make(*problem, 2 + went, now, -sunk * (1 + went));
    problem->thinned = true;
    problem->topology_changed = went;
    for (int i = 0; i < 3; ++i) {
      const ForceSample f = tick();
      EXPECT_NEAR(f.force.z(), after + (before - after) * (1 - (i + 1) / 3.0), wall::tolerance * before);
      EXPECT_EQ(f.status, 0u);
    }
    before = after;
  }
}

// Damped tissue that loses elements gives way from then on: the tick after has only so long of it.
TEST_F(HapticStep, AfterARemovalViscosityCountsFromItsPublication) {
  soften();
  settle();
  EXPECT_DOUBLE_EQ(state->patch.period, 1e-3);
  publish = false;
  const auto before = std::exchange(problem, std::make_unique<CondensedProblem>());  // and stays as it is
  wall::make(*problem, 2, now + ms - ms * 6 / 10);
  soften();
  problem->topology_changed = true;
  tick();
  EXPECT_DOUBLE_EQ(state->patch.period, 0.6e-3);
  tick();
  EXPECT_DOUBLE_EQ(state->patch.period, 1e-3);
}

// Pressed at constant speed the force rises by as much in each tick, whatever part of which was whose.
TEST_F(HapticStep, ARemovalThatTakesNothingIsNotFelt) {
  options.blend_time = 0;
  soften();
  settle();
  const auto press = [&] {
    height -= 1e-6;
    return tick().force.z();
  };
  for (int i = 0; i < 100; ++i) press();
  publish = false;
  std::uint64_t step = 1;
  for (const std::int64_t age : {0, 1, 4, 6, 9, 10}) {
    double last = press();
    const double rise = press() - last;
    ASSERT_GT(rise, 1e-4);
    last += rise;
    const auto before = std::exchange(problem, std::make_unique<CondensedProblem>());  // and stays as it is
    wall::make(*problem, ++step, now + ms - ms * age / 10);
    soften();
    problem->topology_changed = true;
    for (int i = 0; i < 4; ++i) {
      const double f = press();
      EXPECT_NEAR(f - last, rise, 1e-3 * rise) << age << ", tick " << i;
      last = f;
    }
  }
}

TEST_F(HapticStep, ResumingAfterAStallIsBlended) {
  const double before = settle().force.z();
  for (int age = 1; age <= 5; ++age) tick(false);
  height -= 0.05e-3;
  const double after = before + 5 * wall::stiffness * 0.05e-3;
  for (int i = 0; i < 5; ++i) {
    const ForceSample f = tick();
    EXPECT_TRUE(f.status & status_blending);
    EXPECT_NEAR(f.force.z(), after + (before - after) * (1 - (i + 1) / 6.0), wall::tolerance * before);
  }
}

TEST_F(HapticStep, DeviceLimitsAreObeyed) {
  height = wall::radius - 0.5e-3;
  device.force_scale = 50;  // 200 N/m · 0.5 mm · 50 = 5 N
  ForceSample f = settle();
  EXPECT_NEAR(f.force.norm(), 3, 1e-12);
  EXPECT_TRUE(f.status & status_saturated);
  device.max_force_rate = 100;
  wall::make(*problem, 2, now, -1e-3);  // the wall is gone from under the tip
  f = tick();
  EXPECT_NEAR(f.force.norm(), 2.9, 1e-12);
  EXPECT_TRUE(f.status & status_slew_limited);
}

TEST_F(HapticStep, ForceThatIsNotFiniteBecomesZeroAndLatches) {
  settle();
  device.force_scale = std::numeric_limits<double>::infinity();
  ForceSample f = tick();
  EXPECT_EQ(f.force, Vec3::Zero());
  EXPECT_EQ(f.torque, Vec3::Zero());
  EXPECT_EQ(f.status, status_not_finite | status_latched | status_disarmed);
  device.force_scale = 5;
  f = tick();
  EXPECT_EQ(f.force, Vec3::Zero());
  EXPECT_TRUE(f.status & status_latched);
}

TEST_F(HapticStep, ProblemThatIsNotFiniteBecomesZeroAndLatches) {
  settle();
  problem->nodes = 1;
  problem->x_free[0] = problem->x_now[0] = Vec3::Zero();
  problem->sample[0].node = {0, 0, 0};
  problem->sample[0].weight = {1, 0, 0};
  problem->C().setConstant(std::nan(""));
  const ForceSample f = tick();
  EXPECT_EQ(f.force, Vec3::Zero());
  EXPECT_EQ(f.status, status_not_finite | status_latched | status_disarmed);
}

TEST_F(HapticStep, RefusedStateMovesNothing) {
  const Vec3 before = settle().force;
  HapticInput in = input();
  in.device[0].sample.pose.p.setConstant(std::nan(""));
  const ForceSample f = tick(in);
  EXPECT_LT((f.force - before).norm(), 1e-9);
  EXPECT_EQ(f.status, status_rejected);
  EXPECT_EQ(f.echo_sequence, sequence - 1);
  EXPECT_FALSE(f.answers);
}

TEST_F(HapticStep, WithoutAProblemThereIsNoForce) {
  const ForceSample f = haptic_step(nullptr, instrument, device, options, input(), *state);
  EXPECT_EQ(f.force, Vec3::Zero());
  EXPECT_EQ(f.status, status_disarmed | status_problem_lost);
  EXPECT_EQ(f.problem_age_ns, -1);
}

TEST_F(HapticStep, PassivityControlTakesBackTheEnergyOfTheHoldAndIsOffByDefault) {
  // A fast in-and-out stroke on a sampled spring makes energy.
  const auto stroke = [&] {
    height = wall::radius;
    settle();
    double lowest = 0;
    for (int cycle = 0; cycle < 20; ++cycle)
      for (int k = 0; k < 10; ++k) {
        height += (k < 5 ? -1 : 1) * 0.05e-3;
        lowest = std::min(lowest, tick().energy);
      }
    return std::make_pair(lowest, state->device[0].passivity.energy);
  };
  const auto without = stroke();
  EXPECT_LT(without.second, -1e-4);
  state = std::make_unique<HapticState>();
  sequence = 0;
  options.passivity_control = true;
  const auto with = stroke();
  EXPECT_GT(with.second, 0.2 * without.second);
}

TEST_F(HapticStep, SimulationSeesThePedalsOnlyWhileStatesCome) {
  HapticInput in = input();
  in.device[0].sample.buttons = pedal_phaco;
  tick(in);
  InstrumentInput seen = instrument_input(device, options.watchdog, state->device[0].watchdog, now);
  EXPECT_TRUE(seen.present);
  EXPECT_EQ(seen.buttons, pedal_phaco);
  EXPECT_NEAR(seen.X.p.z(), height, 1e-15);
  seen = instrument_input(device, options.watchdog, state->device[0].watchdog, now + 10 * ms);
  EXPECT_FALSE(seen.present);
  EXPECT_EQ(seen.buttons, 0u);
  EXPECT_NEAR(seen.X.p.z(), height, 1e-15);
}

}  // namespace
}  // namespace hapticd
