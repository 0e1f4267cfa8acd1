#include "tools/client_library/force_watch.h"

#include <limits>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr Feel two_newtons{{0, 0, 2}, {}, 0};
constexpr std::array<double, 3> zero{};

// A Touch that may turn as well, 0.2 N and 0.02 N m a slot.
DeviceSettings touch() {
  DeviceSettings limits;
  limits.max_force = 3;
  limits.max_torque = 0.3;
  limits.max_force_rate = 200;
  return limits;
}

// As fast as nobody's hand can tell.
DeviceSettings fast() {
  DeviceSettings limits = touch();
  limits.max_force_rate = 1e5;
  return limits;
}

double along(const std::array<double, 3>& v) { return v[2]; }

TEST(ForceWatch, AForceIsFeltForSevenMillisecondsAfterItCame) {
  ForceWatch watch(fast());
  EXPECT_EQ(watch.feel(0).force, zero);
  watch.sent(7, 100);
  EXPECT_TRUE(watch.heard(5 * ms, 7, 100, two_newtons));
  EXPECT_EQ(watch.feel(5 * ms).force, two_newtons.force);
  EXPECT_EQ(watch.feel(12 * ms - 1).force, two_newtons.force);
  EXPECT_EQ(watch.feel(12 * ms).force, zero);
  EXPECT_EQ(watch.feel(15 * ms).force, zero);
  EXPECT_EQ(watch.feel(15 * ms).status, status_disarmed);
  EXPECT_EQ(watch.silences(), 1u);
  watch.slot(false, true);
  EXPECT_FALSE(watch.heard(20 * ms, 7, 100, two_newtons));  // the daemon lives, though it heard nothing new
  EXPECT_EQ(watch.feel(20 * ms).force, two_newtons.force);
  EXPECT_EQ(watch.longest_silence_ns(), 15 * ms);
}

TEST(ForceWatch, WhatAnswersAnotherClientIsNotFelt) {
  ForceWatch watch(fast());
  watch.sent(7, 100);
  EXPECT_FALSE(watch.heard(ms, 0, 0, two_newtons));    // no state yet
  EXPECT_FALSE(watch.heard(ms, 7, 101, two_newtons));  // the same number, sent at another time
  EXPECT_FALSE(watch.heard(ms, 8, 100, two_newtons));
  EXPECT_EQ(watch.feel(ms).force, zero);
  for (std::uint64_t n = 8; n < 7 + 257; ++n) watch.sent(n, 100);
  EXPECT_FALSE(watch.heard(ms, 7, 100, two_newtons));  // ours, but a quarter of a second old
}

TEST(ForceWatch, NotFiniteIsZeroAtOnce) {
  ForceWatch watch(fast());
  watch.sent(1, 1);
  watch.heard(ms, 1, 1, two_newtons);
  EXPECT_EQ(watch.feel(ms).force, two_newtons.force);
  for (double bad : {std::nan(""), std::numeric_limits<double>::infinity()})
    for (const Feel& feel : {Feel{{0, bad, 1}, {}, 3}, Feel{{0, 0, 1}, {0, bad, 0}, 3}}) {
      watch.heard(ms, 1, 1, feel);
      EXPECT_EQ(watch.feel(ms).force, zero);
      EXPECT_EQ(watch.feel(ms).torque, zero);
      EXPECT_EQ(watch.feel(ms).status, 3u | status_not_finite);
    }
}

// 1e9 N and 1e9 N m: 0.2 N and 0.02 N m more in each slot, up to the device's 3 N and 0.3 N m, each in its
// own direction.
TEST(ForceWatch, TheDevicesLimitsHoldWhateverIsAnswered) {
  ForceWatch watch(touch());
  watch.sent(1, 1);
  for (int slot = 1; slot <= 20; ++slot) {
    watch.slot(false, true);
    watch.heard(slot * ms, 1, 1, {{0, 0, -1e9}, {0, 0, 1e9}, 0});
    const Feel felt = watch.feel(slot * ms);
    EXPECT_NEAR(along(felt.force), -std::min(3.0, 0.2 * slot), 1e-12);
    EXPECT_NEAR(along(felt.torque), std::min(0.3, 0.02 * slot), 1e-12);
  }
  ForceWatch three_axes([] {
    DeviceSettings limits = touch();
    limits.max_torque = 0;
    return limits;
  }());
  three_axes.sent(1, 1);
  three_axes.heard(ms, 1, 1, {{0, 0, 0.1}, {0, 0, 1}, 0});
  EXPECT_EQ(three_axes.feel(ms).torque, zero);
  EXPECT_EQ(three_axes.feel(ms).force, (std::array<double, 3>{0, 0, 0.1}));
}

// Answers that alternate come no further in a slot than the slew limit, all together.
TEST(ForceWatch, AllChangesOfASlotTogetherKeepTheSlewLimit) {
  ForceWatch watch(touch());
  watch.sent(1, 1);
  double before = 0;
  for (int slot = 1; slot <= 50; ++slot) {
    watch.slot(false, true);
    double way = 0;
    for (int answer = 0; answer < 5; ++answer) {
      watch.heard(slot * ms, 1, 1, {{0, 0, answer % 2 ? -3.0 : 3.0}, {}, 0});
      const double now = along(watch.feel(slot * ms).force);
      way += std::abs(now - before);
      before = now;
    }
    EXPECT_LE(way, 0.2 + 1e-12);
  }
}

TEST(ForceWatch, ASecondDaemonIsZeroWithinTheSlewLimitUntilItIsGoneAndTheHandLetGo) {
  ForceWatch watch(touch());
  watch.sent(1, 1);
  std::int64_t now = 0;
  const auto slot = [&](bool second, bool enable) {
    watch.slot(second, enable);
    watch.heard(now += ms, 1, 1, {{0, 0, 1}, {}, 0});
    return watch.feel(now);
  };
  for (int i = 0; i < 5; ++i) slot(false, true);
  EXPECT_NEAR(along(slot(false, true).force), 1, 1e-12);
  for (int i = 1; i <= 5; ++i) {
    const Feel felt = slot(i == 1, true);
    EXPECT_NEAR(along(felt.force), 1 - 0.2 * i, 1e-12);
    EXPECT_EQ(felt.status, status_rival);
  }
  EXPECT_EQ(slot(false, true).force, zero);  // gone, and still
  EXPECT_EQ(slot(true, false).force, zero);  // let go, but it is there
  EXPECT_EQ(slot(false, true).force, zero);
  EXPECT_TRUE(watch.latched());
  slot(false, false);
  EXPECT_FALSE(watch.latched());
  EXPECT_GT(along(slot(false, true).force), 0);
}

// One call a millisecond; how often `enable` rose.
int edges(int milliseconds, bool wanted, bool disarmed, bool latched) {
  Arming arming;
  bool before = false;
  int rises = 0;
  for (int i = 1; i <= milliseconds; ++i) {
    const bool now = arming.enable(i * ms, wanted, disarmed, latched);
    EXPECT_FALSE(now && (i <= 50 || !wanted));
    rises += now && !before;
    before = now;
  }
  return rises;
}

TEST(Arming, AsksOnceWhereArmedAgainWhereDisarmedAndNeverForALatch) {
  EXPECT_EQ(edges(2000, true, false, false), 1);
  EXPECT_EQ(edges(2000, true, true, false), 7);  // 50 ms, then every 320 ms
  EXPECT_EQ(edges(2000, true, true, true), 1);
  EXPECT_EQ(edges(2000, false, true, false), 0);
}

}  // namespace
}  // namespace hapticd
