#include "tools/driver/force_watch.h"

#include <limits>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr Feel two_newtons{{0, 0, 2}, {}, 0};
constexpr std::array<double, 3> zero{};

TEST(ForceWatch, AForceIsFeltForTenMillisecondsAfterItCame) {
  ForceWatch watch(0);
  EXPECT_EQ(watch.feel(0).force, zero);
  watch.sent(7, 100);
  EXPECT_TRUE(watch.heard(5 * ms, 7, 100, two_newtons));
  EXPECT_EQ(watch.feel(5 * ms).force, two_newtons.force);
  EXPECT_EQ(watch.feel(15 * ms - 1).force, two_newtons.force);
  EXPECT_EQ(watch.feel(15 * ms).force, zero);
  EXPECT_EQ(watch.feel(16 * ms).force, zero);
  EXPECT_EQ(watch.silences(), 1u);
  EXPECT_FALSE(watch.heard(20 * ms, 7, 100, two_newtons));  // the daemon lives, though it heard nothing new
  EXPECT_EQ(watch.feel(20 * ms).force, two_newtons.force);
  EXPECT_EQ(watch.longest_silence_ns(), 15 * ms);
}

TEST(ForceWatch, WhatAnswersAnotherClientIsNotFelt) {
  ForceWatch watch(0);
  watch.sent(7, 100);
  EXPECT_FALSE(watch.heard(ms, 0, 0, two_newtons));    // no state yet
  EXPECT_FALSE(watch.heard(ms, 7, 101, two_newtons));  // the same number, sent at another time
  EXPECT_FALSE(watch.heard(ms, 8, 100, two_newtons));
  EXPECT_EQ(watch.feel(ms).force, zero);
  for (std::uint64_t n = 8; n < 7 + 257; ++n) watch.sent(n, 100);
  EXPECT_FALSE(watch.heard(ms, 7, 100, two_newtons));  // ours, but a quarter of a second old
}

TEST(ForceWatch, NotFiniteIsZeroAndTheSecondLimitKeepsTheDirection) {
  ForceWatch watch(0.5);
  watch.sent(1, 1);
  for (double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    EXPECT_TRUE(watch.heard(ms, 1, 1, {{0, bad, 1}, {}, 3}) || bad > 0);
    EXPECT_EQ(watch.feel(ms).force, zero);
    watch.heard(ms, 1, 1, {{0, 0, 1}, {0, bad, 0}, 3});
    EXPECT_EQ(watch.feel(ms).force, zero);
    EXPECT_EQ(watch.feel(ms).status, 3u);
  }
  watch.heard(ms, 1, 1, {{0.3, 0, 0.4}, {}, 0});
  EXPECT_EQ(watch.feel(ms).force, (std::array<double, 3>{0.3, 0, 0.4}));
  watch.heard(ms, 1, 1, {{3, 0, -4}, {0, 0, 1}, 0});
  EXPECT_NEAR(watch.feel(ms).force[0], 0.3, 1e-15);
  EXPECT_NEAR(watch.feel(ms).force[2], -0.4, 1e-15);
  EXPECT_NEAR(watch.feel(ms).torque[2], 0.1, 1e-15);
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
