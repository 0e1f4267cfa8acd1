// Each row of the safety table at its exact times.
#include "haptic/watchdog.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

// A client that sends one good state per millisecond, and a problem of age `problem_age`.
struct Watchdog : testing::Test {
  DeviceSettings device;
  WatchdogLimits limits;
  WatchdogState state;
  std::int64_t now = 1000 * ms;
  std::int64_t problem_age = 10 * ms;
  bool enable = true;
  std::uint64_t sequence = 0;
  Vec3 position = Vec3::Zero();

  Watchdog() {
    device.max_speed = 1;
    WatchdogInput nobody;
    nobody.now_ns = now;
    tick(nobody);
  }

  DeviceSample good() {
    DeviceSample s;
    s.sequence = ++sequence;
    s.received_ns = now;
    s.pose.p = position;
    s.enable = enable;
    return s;
  }
  WatchdogInput input(bool with_sample, std::int64_t after) {
    now += after;
    WatchdogInput in;
    in.now_ns = now;
    in.presence.connected = true;
    in.taken = with_sample;
    if (with_sample) in.sample = good();
    in.has_problem = problem_age >= 0;
    in.problem_published_ns = now - problem_age;
    return in;
  }
  Verdict tick(const WatchdogInput& in) { return watch(limits, device, in, state); }
  Verdict fed(std::int64_t after = ms) { return tick(input(true, after)); }
  Verdict starved(std::int64_t after = ms) { return tick(input(false, after)); }
  Verdict first() {
    WatchdogInput in = input(true, ms);
    in.presence.new_client = true;
    return tick(in);
  }
  // Armed and fully ramped up.
  void arm() {
    first();
    for (int i = 0; i < 110; ++i) fed();
    ASSERT_EQ(state.gain, 1);
  }
};

TEST_F(Watchdog, NobodyThereIsDisarmed) {
  WatchdogInput in = input(false, ms);
  in.presence.connected = false;
  const Verdict v = tick(in);
  EXPECT_EQ(v.render, Render::zero);
  EXPECT_EQ(v.status, status_disarmed);
}

TEST_F(Watchdog, FirstStateOfANewClientArmsAndRampsUpIn100ms) {
  Verdict v = first();
  EXPECT_EQ(v.render, Render::contact);
  EXPECT_EQ(v.status, status_ramping_up);
  EXPECT_NEAR(v.gain, 0.01, 1e-12);
  for (int i = 2; i < 100; ++i) {
    v = fed();
    EXPECT_NEAR(v.gain, 0.01 * i, 1e-9);
    EXPECT_EQ(v.status, status_ramping_up);
  }
  EXPECT_NEAR(fed().gain, 1, 1e-9);
  EXPECT_EQ(fed().status, 0u);
}

TEST_F(Watchdog, EnableHasToBeSeenRisingWhereTheClientIsNotNew) {
  for (int i = 0; i < 5; ++i) EXPECT_EQ(fed().status, status_disarmed);
  enable = false;
  EXPECT_EQ(fed().status, status_disarmed);
  enable = true;
  EXPECT_EQ(fed().render, Render::contact);
}

TEST_F(Watchdog, WithdrawnEnableIsZeroInTheSameTick) {
  arm();
  enable = false;
  const Verdict v = fed();
  EXPECT_EQ(v.render, Render::zero);
  EXPECT_EQ(v.gain, 0);
  EXPECT_EQ(v.status, status_disarmed);
}

TEST_F(Watchdog, ArmingWaitsForALiveProblem) {
  problem_age = -1;
  EXPECT_EQ(first().status, status_disarmed | status_problem_lost);
  EXPECT_EQ(fed().status, status_disarmed | status_problem_lost);
  problem_age = 60 * ms;
  EXPECT_EQ(fed().status, status_disarmed | status_problem_old);
  problem_age = 59 * ms;
  EXPECT_EQ(fed().render, Render::contact);
}

TEST_F(Watchdog, HoldsFrom3To10msAndThenRampsToZeroIn5ms) {
  arm();
  for (int age = 1; age <= 2; ++age) EXPECT_EQ(starved().render, Render::contact) << age;
  for (int age = 3; age <= 9; ++age) {
    const Verdict v = starved();
    EXPECT_EQ(v.render, Render::hold) << age;
    EXPECT_EQ(v.status, status_holding) << age;
    EXPECT_EQ(v.gain, 1) << age;
    EXPECT_EQ(v.state_age_ns, age * ms);
  }
  for (int age = 10; age <= 14; ++age) {
    const Verdict v = starved();
    EXPECT_EQ(v.status, status_ramping_down) << age;
    EXPECT_NEAR(v.gain, 1 - 0.2 * (age - 9), 1e-12) << age;
  }
  for (int age = 15; age <= 99; ++age) EXPECT_EQ(starved().gain, 0);
  EXPECT_EQ(starved().status, status_disarmed);  // 100 ms
}

TEST_F(Watchdog, ThresholdsAreExactToTheNanosecond) {
  arm();
  EXPECT_EQ(starved(3 * ms - 1).render, Render::contact);
  EXPECT_EQ(starved(1).render, Render::hold);
  fed();
  starved(4 * ms);
  EXPECT_EQ(starved(4 * ms).status, status_holding);
  EXPECT_EQ(starved(2 * ms - 1).status, status_holding);
  EXPECT_EQ(starved(1).status, status_ramping_down);
}

TEST_F(Watchdog, AStateWithin100msResumesWithTheRampAndLaterOneNeedsAnEdge) {
  arm();
  for (int age = 1; age <= 12; ++age) starved();
  EXPECT_NEAR(state.gain, 0.4, 1e-12);
  Verdict v = fed();
  EXPECT_EQ(v.render, Render::contact);
  EXPECT_NEAR(v.gain, 0.41, 1e-12);
  for (int age = 1; age <= 100; ++age) starved();
  EXPECT_EQ(fed().status, status_disarmed);
  EXPECT_EQ(fed().status, status_disarmed);
  enable = false;
  fed();
  enable = true;
  v = fed();
  EXPECT_EQ(v.status, status_ramping_up);
  EXPECT_NEAR(v.gain, 0.01, 1e-12);
}

TEST_F(Watchdog, OldProblemIsDampingOnlyAndALostOneIsZero) {
  arm();
  problem_age = 60 * ms - 1;
  EXPECT_EQ(fed().render, Render::contact);
  problem_age = 60 * ms;
  Verdict v = fed();
  EXPECT_EQ(v.render, Render::damp);
  EXPECT_EQ(v.status, status_problem_old);
  problem_age = 200 * ms - 1;
  EXPECT_EQ(fed().render, Render::damp);
  problem_age = 200 * ms;
  v = fed();
  EXPECT_EQ(v.render, Render::release);
  EXPECT_EQ(v.status, status_problem_lost);
  problem_age = 0;  // alive again: still armed, from nothing up
  v = fed();
  EXPECT_EQ(v.render, Render::contact);
  EXPECT_NEAR(v.gain, 0.01, 1e-12);
}

TEST_F(Watchdog, VelocityForDampingIsBoundedByTheDevicesSpeed) {
  arm();
  for (int i = 0; i < 200; ++i) {
    position.x() += 0.5e-3;  // 0.5 m/s
    fed();
  }
  EXPECT_NEAR(state.velocity.x(), 0.5, 1e-6);
  device.max_speed = 0.6;
  for (int i = 0; i < 200; ++i) {
    position.x() += 0.599e-3;
    fed();
  }
  EXPECT_LE(state.velocity.norm(), 0.6);
}

TEST_F(Watchdog, OwnGapOf5msMakesTheStateStaleForThatTick) {
  arm();
  Verdict v = fed(5 * ms - 1);
  EXPECT_EQ(v.render, Render::contact);
  EXPECT_EQ(v.status, 0u);
  v = fed(5 * ms);
  EXPECT_EQ(v.render, Render::hold);
  EXPECT_EQ(v.status, status_gap | status_holding);
  EXPECT_EQ(fed().status, 0u);
  v = fed(21 * ms);
  EXPECT_EQ(v.status, status_gap | status_ramping_down);
  EXPECT_NEAR(v.gain, 0.8, 1e-12);  // the gap counts as one period, the device held its force
  v = fed(100 * ms);
  EXPECT_EQ(v.status, status_gap | status_disarmed);
  EXPECT_EQ(v.render, Render::release);
}

TEST_F(Watchdog, RefusedStatesAreAsIfTheyHadNotComeAndThreeInARowLatch) {
  arm();
  const auto bad = [&] {
    WatchdogInput in = input(true, ms);
    in.sample.pose.p.x() = std::nan("");
    return tick(in);
  };
  Verdict v = bad();
  EXPECT_EQ(v.refusal, Refusal::not_finite);
  EXPECT_EQ(v.status, status_rejected);
  EXPECT_EQ(v.state_age_ns, ms);  // of the last good one
  EXPECT_FALSE(v.answers);
  EXPECT_EQ(bad().status, status_rejected);
  EXPECT_EQ(fed().status, 0u);  // not in a row
  bad();
  bad();
  v = bad();
  EXPECT_EQ(v.status, status_rejected | status_latched | status_disarmed);
  EXPECT_EQ(v.render, Render::release);
  EXPECT_EQ(state.refused, 5u);
  EXPECT_EQ(fed().status, status_latched | status_disarmed);  // a good state does not unlatch
  enable = false;
  EXPECT_EQ(fed().status, status_disarmed);  // seeing enable false does
  enable = true;
  EXPECT_EQ(fed().status, status_ramping_up);
}

TEST_F(Watchdog, EveryKindOfRefusalCountsTowardsTheLatch) {
  arm();
  WatchdogInput in = input(true, ms);
  in.sample.sequence = 1;
  EXPECT_EQ(tick(in).refusal, Refusal::sequence_not_rising);
  in = input(true, ms);
  in.sample.pose.p.x() = 0.5;
  EXPECT_EQ(tick(in).refusal, Refusal::jump);
  in = input(true, ms);
  in.sample.pose.q.coeffs() *= 2;
  const Verdict v = tick(in);
  EXPECT_EQ(v.refusal, Refusal::not_unit_quaternion);
  EXPECT_TRUE(v.status & status_latched);
}

// A state far ahead of its client's numbers, whoever sent it: the client lets go, and is served again.
TEST_F(Watchdog, NumbersBeginAnewWhereALatchIsLetGo) {
  arm();
  WatchdogInput in = input(true, ms);
  in.sample.sequence = std::uint64_t{1} << 63;
  EXPECT_EQ(tick(in).refusal, Refusal::none);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(fed().refusal, Refusal::sequence_not_rising);
  EXPECT_TRUE(fed().status & status_latched);
  enable = false;
  EXPECT_EQ(fed().status, status_disarmed);
  enable = true;
  EXPECT_EQ(fed().status, status_ramping_up);
}

TEST_F(Watchdog, WhoWritesEveryTickIsOneConflict) {
  arm();
  for (int i = 0; i < 500; ++i) {
    WatchdogInput in = input(true, ms);
    in.presence.conflict = true;
    tick(in);
  }
  EXPECT_LE(state.conflicts, 5u);
}

TEST_F(Watchdog, ConflictShowsFor100msAndChangesNothingForTheFirst) {
  arm();
  WatchdogInput in = input(true, ms);
  in.presence.conflict = true;
  Verdict v = tick(in);
  EXPECT_EQ(v.status, status_conflict);
  EXPECT_EQ(v.render, Render::contact);
  EXPECT_EQ(v.gain, 1);
  EXPECT_EQ(state.conflicts, 1u);
  for (int i = 1; i < 100; ++i) EXPECT_EQ(fed().status, status_conflict);
  EXPECT_EQ(fed().status, 0u);
}

// As after 10 ms without a state: zero in 5 ms, disarmed and latched after 90.
TEST_F(Watchdog, ASecondDaemonLetsTheForceDownAndLatches) {
  arm();
  const auto heard = [&](bool rival) {
    WatchdogInput in = input(true, ms);
    in.presence.rival = rival;
    return tick(in);
  };
  for (int i = 0; i < 90; ++i) {
    const Verdict v = heard(i < 3);
    EXPECT_EQ(v.render, Render::hold) << i;
    EXPECT_EQ(v.status, status_ramping_down | status_rival) << i;
    EXPECT_NEAR(v.gain, std::max(0.0, 1 - 0.2 * (i + 1)), 1e-12) << i;
  }
  for (int i = 0; i < 200; ++i) {
    const Verdict v = heard(false);
    EXPECT_EQ(v.render, Render::release);
    EXPECT_EQ(v.status, status_disarmed | status_rival | status_latched);
  }
  enable = false;
  heard(true);  // let go, but it is heard again
  enable = true;
  EXPECT_EQ(heard(false).status, status_disarmed | status_rival | status_latched);
  enable = false;
  EXPECT_EQ(heard(false).status, status_disarmed);
  enable = true;
  EXPECT_EQ(heard(false).status, status_ramping_up);
}

TEST_F(Watchdog, NothingIsArmedBesideASecondDaemonNorBeforeThereWasTimeToHearOne) {
  const auto tick_with = [&](bool rival, bool settled) {
    WatchdogInput in = input(true, ms);
    in.presence.new_client = !state.has_sample;
    in.presence.rival = rival;
    in.presence.settled = settled;
    return tick(in);
  };
  for (int i = 0; i < 300; ++i) EXPECT_EQ(tick_with(false, false).status, status_disarmed);
  EXPECT_EQ(tick_with(true, true).status, status_disarmed | status_rival | status_latched);
  state = {};
  for (int i = 0; i < 300; ++i) EXPECT_EQ(tick_with(false, false).status, status_disarmed);
  EXPECT_EQ(tick_with(false, true).status, status_ramping_up);
}

TEST_F(Watchdog, ClientGoneIsZeroInTheSameTickAndTheNextClientArms) {
  arm();
  WatchdogInput in = input(true, ms);
  in.presence.connected = false;
  const Verdict v = tick(in);
  EXPECT_EQ(v.render, Render::zero);
  EXPECT_EQ(v.gain, 0);
  EXPECT_EQ(v.status, status_disarmed);
  sequence = 0;        // the next one counts afresh
  position.x() = 0.5;  // and is somewhere else
  EXPECT_EQ(first().status, status_ramping_up);
}

TEST_F(Watchdog, ANewClientWithoutEnableArmsWhenItRises) {
  enable = false;
  EXPECT_EQ(first().status, status_disarmed);
  enable = true;
  EXPECT_EQ(fed().render, Render::contact);
}

TEST_F(Watchdog, ForceThatWasNotFiniteLatchesUntilEnableIsSeenFalse) {
  arm();
  latch_not_finite(state);
  const std::uint32_t latched = status_not_finite | status_latched | status_disarmed;
  EXPECT_EQ(fed().status, latched);
  EXPECT_EQ(first().status, latched);  // it was not the client's fault: a new client does not clear it
  enable = false;
  EXPECT_EQ(fed().status, status_disarmed);
  enable = true;
  EXPECT_EQ(fed().render, Render::contact);
}

}  // namespace
}  // namespace hapticd
