// Two devices in one tissue: whatever happens to one, the other's force stays within its own limits and ends
// as that of its hand alone.
#include <cmath>
#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "tests/haptic/two_devices.h"

namespace hapticd {
namespace {

using two_devices::Hands;
using two_devices::ms;

constexpr double alone_tolerance = 1e-4;  // of a force: friction remembers where it was pushed

// What this hand feels where the other's client never was.
Vec3 force_alone(int hand, double first, double second, double friction) {
  Hands alone(friction);
  alone.in.device[1 - hand].presence.connected = false;
  alone.press(first, second);
  EXPECT_TRUE(alone.armed(hand));
  return alone.force[hand].force;
}

struct TwoDevices : testing::TestWithParam<int> {
  const int a = GetParam(), b = 1 - a;  // the one that behaves, and the other
  Hands hands{0};

  void SetUp() override {
    hands.press(0.4e-3, 0.5e-3);
    for (const int i : {a, b}) {
      ASSERT_EQ(hands.force[i].status, 0u);
      ASSERT_TRUE(hands.present(i));
      ASSERT_GT(hands.force[i].force.norm(), 5 * hands.step(i));
    }
    alone = force_alone(a, 0.4e-3, 0.5e-3, 0);
    together = hands.force[a].force;
    // Cross-compliance: each stands in the dent of the other.
    ASSERT_GT((alone - together).norm(), 2 * hands.step(a));
  }
  void expect_unharmed() {
    const ForceSample& f = hands.force[a];
    ASSERT_TRUE(f.force.allFinite() && f.torque.allFinite());
    ASSERT_LE((f.force - hands.before[a].force).norm(), hands.step(a) * (1 + 1e-12));
    ASSERT_LE(f.force.norm(), hands.device(a).max_force);
    ASSERT_FALSE(f.status & (status_disarmed | status_latched | status_rejected | status_not_finite |
                             status_holding | status_ramping_down | status_conflict))
        << f.status;
  }
  void expect_alone() const {
    EXPECT_FALSE(hands.present(b));
    EXPECT_TRUE(hands.present(a));
    EXPECT_LT((hands.force[a].force - alone).norm(), alone_tolerance * alone.norm());
    EXPECT_EQ(hands.force[b].force, Vec3::Zero());
  }
  // Ticks in which the other one's client does that.
  void others(int ticks, const std::function<void(DeviceInput&)>& does) {
    for (int n = 0; n < ticks; ++n) {
      hands.tick([&](HapticInput& now) { does(now.device[b]); });
      expect_unharmed();
      if (HasFatalFailure()) return;
    }
  }

  Vec3 alone, together;
};

TEST_P(TwoDevices, AHeldInstrumentStaysInPlaceForTenMillisecondsAndIsThenOutAndBlended) {
  const Vec3 held = hands.force[b].force;
  bool blending = false;
  for (int age = 1; age <= 70; ++age) {
    others(1, [](DeviceInput& d) { d.taken = false; });
    const ForceSample& f = hands.force[b];
    EXPECT_EQ(hands.present(b), age < 10) << age;
    EXPECT_EQ((f.status & status_holding) != 0, age >= 3 && age < 10) << age;
    if (age < 10) {
      EXPECT_LT((hands.force[a].force - together).norm(), alone_tolerance * together.norm()) << age;
    }
    if (age >= 3 && age < 10) {
      EXPECT_EQ(f.force, held) << age;
    }
    if (age >= 60) {  // as fast as its slew limit allows
      EXPECT_EQ(f.force, Vec3::Zero()) << age;
    }
    blending = blending || hands.force[a].status & status_blending;
  }
  EXPECT_TRUE(blending);
  expect_alone();
}

TEST_P(TwoDevices, WhoComesBackWithinTheHoldIsFeltAsIfNothingHadBeen) {
  others(8, [](DeviceInput& d) { d.taken = false; });
  others(10, [](DeviceInput&) {});
  EXPECT_LT((hands.force[a].force - together).norm(), alone_tolerance * together.norm());
  EXPECT_TRUE(hands.present(b));
}

TEST_P(TwoDevices, AClientThatIsGoneOrLetsGoIsZeroAtOnceAndOutOfTheContact) {
  for (const bool gone : {true, false}) {
    others(1, [&](DeviceInput& d) { (gone ? d.presence.connected : d.sample.enable) = false; });
    EXPECT_EQ(hands.force[b].force, Vec3::Zero());
    EXPECT_FALSE(hands.present(b));
    EXPECT_TRUE(hands.force[a].status & status_blending);
    others(40, [&](DeviceInput& d) { (gone ? d.presence.connected : d.sample.enable) = false; });
    expect_alone();
    // It arms again in the middle of the tissue, and the other one feels that gently too.
    others(1, [&](DeviceInput& d) { d.presence.new_client = gone; });
    others(300, [](DeviceInput&) {});
    EXPECT_EQ(hands.force[b].status, 0u);
    EXPECT_LT((hands.force[a].force - together).norm(), alone_tolerance * together.norm());
  }
}

// Its slew limit would let the whole step through.
TEST_P(TwoDevices, WhoIsArmedInTheTissueIsBlendedForTheOtherWhenAProblemReachesIt) {
  others(1, [](DeviceInput& d) { d.sample.enable = false; });
  others(40, [](DeviceInput& d) { d.sample.enable = false; });
  for (DeviceSettings& d : hands.devices) d.max_force_rate = 1e3;
  // A problem without the samples near it, as of the step before it came.
  const auto far = std::make_unique<CondensedProblem>(*hands.problem);
  far->samples = 0;
  for (int k = 0; k < hands.problem->samples; ++k) {
    const PatchSample& s = hands.problem->sample[k];
    double x = 0;
    for (int c = 0; c < 3; ++c) x += s.weight[c] * hands.problem->x_free[s.node[c]].x();
    if (x * (a - 0.5) > 0) far->sample[far->samples++] = s;
  }
  std::swap(*far, *hands.problem);
  others(20, [](DeviceInput&) {});
  ASSERT_TRUE(hands.present(b));
  ASSERT_EQ(hands.force[b].force, Vec3::Zero());
  std::swap(*far, *hands.problem);
  hands.problem->step = far->step + 1;
  const Vec3 before = hands.force[a].force;
  others(1, [](DeviceInput&) {});
  EXPECT_TRUE(hands.force[a].status & status_blending);
  const double first = (hands.force[a].force - before).norm();
  others(10, [](DeviceInput&) {});
  const double whole = (hands.force[a].force - before).norm();
  EXPECT_GT(whole, 1e-4);
  EXPECT_LT(first, 0.25 * whole);
}

// Balls that overlap over the sheet: a hand that is on its way in pushes the other by no more than it feels.
TEST_P(TwoDevices, WhoIsArmedOnTheOtherInstrumentPushesItAsFarAsItIsPushed) {
  Hands two(0.2);
  const double reach = 0.55 * two_devices::apart;
  two.instruments = {sphere_instrument(reach), sphere_instrument(reach)};
  for (DeviceSettings& d : two.devices) d.max_force = d.max_force_rate = 1e3;
  const auto tick = [&](bool enable) {
    two.tick([&](HapticInput& now) { now.device[b].sample.enable = enable; });
  };
  for (int n = 0; n < 150; ++n) tick(false);
  ASSERT_EQ(two.force[a].force, Vec3::Zero());
  const double whole = 100 * (2 * reach - two_devices::apart);  // both couplings in series
  double least = 1;
  for (int n = 0; n < 150; ++n) {
    tick(true);
    const Vec3 f = two.force[a].force;
    least = std::min(least, f.norm() / whole);
    EXPECT_LT((f + two.force[b].force).norm(), 1e-12 + 1e-9 * f.norm()) << n;
  }
  EXPECT_LT(least, 0.1);
  EXPECT_EQ(two.force[b].status, 0u);
  EXPECT_NEAR(two.force[a].force.norm(), whole, 0.01 * whole);
}

TEST_P(TwoDevices, ALatchedOneIsReleasedWithinItsOwnLimitAndIsOutOfTheContact) {
  others(3, [](DeviceInput& d) { d.sample.pose.p.x() = std::nan(""); });
  EXPECT_TRUE(hands.force[b].status & status_latched);
  EXPECT_FALSE(hands.present(b));
  for (int n = 0; n < 60; ++n) {
    others(1, [](DeviceInput& d) { d.sample.pose.p.x() = std::nan(""); });
    EXPECT_LE((hands.force[b].force - hands.before[b].force).norm(), hands.step(b) * (1 + 1e-12));
  }
  expect_alone();
}

// A pose that is finite, and absurd, from the first state on: nothing to compare it with.
TEST_P(TwoDevices, AnAbsurdPoseOfANewClientIsItsOwnAffair) {
  for (const double absurd : {1e3, 1e9, 1e150, 1e200, 1e300}) {
    others(1, [](DeviceInput& d) { d.presence.connected = false; });
    others(1, [&](DeviceInput& d) {
      d.presence.new_client = true;
      d.sample.pose.p = Vec3(absurd, -absurd, absurd);
    });
    others(40, [&](DeviceInput& d) { d.sample.pose.p = Vec3(absurd, -absurd, absurd); });
    ASSERT_FALSE(HasFatalFailure()) << absurd;
    EXPECT_LT((hands.force[a].force - alone).norm(), alone_tolerance * alone.norm()) << absurd;
    EXPECT_EQ(hands.force[b].force, Vec3::Zero()) << absurd;
  }
}

TEST_P(TwoDevices, ASecondClientAndARivalDaemonOfOneAreNothingToTheOther) {
  others(20, [](DeviceInput& d) { d.presence.conflict = true; });
  EXPECT_TRUE(hands.force[b].status & status_conflict);
  EXPECT_LT((hands.force[a].force - together).norm(), alone_tolerance * together.norm());
  others(120, [](DeviceInput& d) { d.presence.rival = true; });
  EXPECT_TRUE(hands.force[b].status & status_rival);
  expect_alone();
}

// Damping replaces both forces; who falls silent meanwhile is not put back into the tissue by the next
// problem.
// The ghost's spring would be 0.26 N long; the other's hand is 2.6 mm away.
TEST_P(TwoDevices, AGhostIsBoundedAndGoesWithTheOtherWithinTheSlewLimit) {
  constexpr double most = 4e-3;
  Hands guided{0};
  guided.device(a).ghost = {.of = b, .stiffness = 100, .max_force = most};
  guided.press(0.4e-3, 0.5e-3);
  const Vec3 ghost((b - a) * most, 0, 0);
  // Towards the other, beside what the tissue says.
  EXPECT_NEAR(guided.force[a].force.x() - together.x(), ghost.x(), 0.02 * most);
  EXPECT_LT((guided.force[a].force - together).norm(), 1.02 * most);
  EXPECT_EQ(guided.force[b].force, hands.force[b].force);
  const auto lone = [&](int ticks, const std::function<void(DeviceInput&)>& does) {
    for (int k = 0; k < ticks; ++k) {
      guided.tick([&](HapticInput& in) { does(in.device[b]); });
      ASSERT_LE((guided.force[a].force - guided.before[a].force).norm(), guided.step(a) * (1 + 1e-12));
    }
  };
  // Silent, gone, or not armed; and back as its own force rises.
  for (const auto& does : std::vector<std::function<void(DeviceInput&)>>{
           [](DeviceInput& d) { d.taken = false; }, [](DeviceInput& d) { d.presence.connected = false; },
           [](DeviceInput& d) { d.sample.enable = false; }}) {
    lone(120, does);
    EXPECT_LT((guided.force[a].force - alone).norm(), 1e-3 * alone.norm());
    lone(2, [](DeviceInput& d) { d.sample.enable = false; });
    lone(2, [](DeviceInput& d) { d.presence.new_client = true; });
    lone(10, [](DeviceInput&) {});
    EXPECT_LT(std::abs(guided.force[a].force.x() - together.x()), 0.5 * most);
    lone(300, [](DeviceInput&) {});
    EXPECT_NEAR(guided.force[a].force.x() - together.x(), ghost.x(), 0.02 * most);
  }
  // The other jumps as far as it may: no more than the slew limit is felt, no more than the bound is pulled.
  guided.depth[b] = -1.4e-3;
  lone(1, [](DeviceInput&) {});
  // An old problem is damping alone.
  guided.publish = false;
  guided.tick({}, 70 * ms);
  lone(100, [](DeviceInput&) {});
  EXPECT_TRUE(guided.force[a].status & status_problem_old);
  EXPECT_LT(guided.force[a].force.norm(), 1e-9);
}

TEST_P(TwoDevices, WhoFallsSilentWhileTheProblemIsOldIsNotInTheNextContact) {
  hands.publish = false;
  for (int n = 0; n < 100; ++n) hands.tick();
  ASSERT_TRUE(hands.force[a].status & status_problem_old);
  for (int n = 0; n < 4; ++n) others(1, [](DeviceInput& d) { d.taken = false; });
  ASSERT_TRUE(hands.force[b].status & status_holding);
  hands.publish = true;
  others(1, [](DeviceInput& d) { d.taken = false; });
  EXPECT_FALSE(hands.present(b));
  EXPECT_TRUE(hands.present(a));
}

INSTANTIATE_TEST_SUITE_P(Either, TwoDevices, testing::Values(0, 1),
                         [](const auto& p) { return p.param == 0 ? "First" : "Second"; });

// Every row of the safety table on both devices, at random and on top of one another.
TEST(TwoDevicesAtRandom, AnyOrderOfEventsOnBothKeepsBothLimits) {
  std::mt19937 random(9);
  const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  Hands hands;
  EachInstrument<std::uint32_t> seen;
  EachInstrument<double> peak, speed;
  int changes = 0;  // felt by one that behaves while the other comes or goes
  EachInstrument<int> silent, lying, gone;
  for (int t = 0; t < 40'000; ++t) {
    std::int64_t after = ms;
    for (int i = 0; i < Hands::count; ++i) {
      if (below(60) == 0) speed[i] = 0.05 * (2.0 * below(1000) / 999 - 1);
      if ((hands.depth[i] > 0.8e-3 && speed[i] > 0) || (hands.depth[i] < -2e-3 && speed[i] < 0))
        speed[i] *= -1;
      hands.depth[i] += 1e-3 * speed[i];
      if (below(400) == 0) silent[i] = below(130);
      if (below(400) == 0) lying[i] = below(6);
      if (below(1000) == 0) gone[i] = below(20);
    }
    if (below(20) == 0) ++hands.problem->step;
    hands.problem->topology_changed = below(8) == 0;
    if (below(500) == 0) hands.publish = !hands.publish;
    if (below(500) == 0) after = (2 + below(120)) * ms;
    const EachInstrument<bool> were = hands.state->X.present;
    EachInstrument<bool> exempt;
    hands.tick(
        [&](HapticInput& now) {
          for (int i = 0; i < Hands::count; ++i) {
            DeviceInput& d = now.device[i];
            d.taken = silent[i] == 0;
            if (silent[i] > 0) --silent[i];
            if (lying[i] > 0) --lying[i], d.sample.pose.p.y() = std::numeric_limits<double>::infinity();
            d.presence.connected = gone[i] == 0;
            if (gone[i] > 0 && --gone[i] == 0) d.presence.new_client = true;
            d.presence.conflict = below(300) == 0;
            d.presence.rival = t % 9000 > 8900 && below(2) == i;
            const bool out = !hands.armed(i);
            d.sample.enable = below(out ? 40 : 400) != 0;
            exempt[i] = !d.presence.connected || !d.sample.enable;
          }
        },
        after);
    for (int i = 0; i < Hands::count; ++i) {
      const ForceSample& f = hands.force[i];
      seen[i] |= f.status;
      ASSERT_TRUE(f.force.allFinite());
      ASSERT_LE(f.force.norm(), hands.device(i).max_force * (1 + 1e-12));
      const bool let_go = exempt[i] || !hands.state->device[i].watchdog.sample.enable;
      if (!let_go || f.force.norm() > 0) {
        ASSERT_LE((f.force - hands.before[i].force).norm(), hands.step(i) * (1 + 1e-9))
            << t << ' ' << f.status;
      }
      if (f.status & status_disarmed) {
        ASSERT_EQ(f.force, Vec3::Zero()) << f.status;
      }
      ASSERT_FALSE(f.status & status_not_finite);
      peak[i] = std::max(peak[i], f.force.norm());
    }
    changes += hands.state->solved && were.value != hands.state->X.present.value &&
               (hands.force[0].status & hands.force[1].status & status_disarmed) == 0;
  }
  EXPECT_GT(changes, 50);
  const std::uint32_t all = status_disarmed | status_holding | status_ramping_down | status_ramping_up |
                            status_problem_old | status_problem_lost | status_gap | status_rejected |
                            status_latched | status_conflict | status_slew_limited | status_blending |
                            status_rival;
  for (int i = 0; i < Hands::count; ++i) {
    EXPECT_EQ(seen[i] & all, all) << i;
    EXPECT_GT(peak[i], 0.25 * hands.device(i).max_force);
  }
}

}  // namespace
}  // namespace hapticd
