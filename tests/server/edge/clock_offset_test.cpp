// Another machine's clock is known as well as its bound says, whatever the network and the clocks do.
#include "server/edge/clock_offset.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

// Their clock: runs at another rate from another beginning.
struct Clocks {
  std::int64_t offset;
  double drift;
  std::int64_t theirs(std::int64_t ours) const {
    return ours + offset + std::llround(drift * static_cast<double>(ours));
  }
};

TEST(ClockOffset, ErrsByNoMoreThanItsBound) {
  std::mt19937_64 random(1);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int run = 0; run < 50; ++run) {
    const Clocks clocks{static_cast<std::int64_t>(between(-0.5e9, 1e15)),
                        between(-ClockOffset::drift, ClockOffset::drift)};
    const double out = between(0, 50e6), back = between(0, 50e6), jitter = between(0, 30e6);
    ClockOffset clock;
    for (std::int64_t now = 1000 * ms; now < 20'000 * ms; now += 20 * ms) {
      const auto heard = now + std::llround(out + between(0, jitter));
      const auto answered = heard + std::llround(between(0, 2e6));
      const auto home = answered + std::llround(back + between(0, jitter));
      ASSERT_TRUE(clock.note({now, clocks.theirs(heard), clocks.theirs(answered), home}));
      const std::int64_t truth = clocks.theirs(home) - home;
      // A microsecond for what drifts within the trip itself.
      ASSERT_LE(std::abs(clock.ns() - truth),
                clock.error_ns(home) + 1000 + std::llround(ClockOffset::drift * 1e8));
    }
  }
}

TEST(ClockOffset, OfARouteWithEqualWaysIsExact) {
  ClockOffset clock;
  ASSERT_TRUE(clock.note({100 * ms, 5'103 * ms, 5'104 * ms, 107 * ms}));
  EXPECT_EQ(clock.ns(), 5'000 * ms);
  EXPECT_EQ(clock.error_ns(107 * ms), 3 * ms);
  EXPECT_EQ(clock.ours(5'200 * ms), 200 * ms);
  EXPECT_EQ(clock.theirs(200 * ms), 5'200 * ms);
}

TEST(ClockOffset, KeepsTheBestTripUntilItsDriftIsWorse) {
  ClockOffset clock;
  ASSERT_TRUE(clock.note({0, 1 * ms, 1 * ms, 2 * ms}));
  ASSERT_TRUE(clock.note({100 * ms, 120 * ms, 120 * ms, 140 * ms}));  // 20 ms each way
  EXPECT_EQ(clock.error_ns(140 * ms), 1 * ms + 69'000);
  // A minute later the first may have drifted by 30 ms, and a trip of 20 ms is better.
  ASSERT_TRUE(clock.note({60'000 * ms, 60'020 * ms, 60'020 * ms, 60'040 * ms}));
  EXPECT_EQ(clock.error_ns(60'040 * ms), 20 * ms);
}

TEST(ClockOffset, LeavesOutTripsThatCannotBe) {
  ClockOffset clock;
  EXPECT_FALSE(clock.note({10, 5, 5, 9}));     // back before it was asked
  EXPECT_FALSE(clock.note({10, 9, 5, 20}));    // answered before it was heard
  EXPECT_FALSE(clock.note({10, 5, 500, 20}));  // longer there than altogether
  EXPECT_FALSE(clock.note({10, INT64_MAX, 5, 20}));
  EXPECT_FALSE(clock.note({INT64_MIN, 5, 6, 20}));
  EXPECT_FALSE(clock.known());
}

}  // namespace
}  // namespace hapticd
