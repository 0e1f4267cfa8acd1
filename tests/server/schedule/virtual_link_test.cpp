#include "server/schedule/virtual_link.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

TEST(VirtualLink, WithoutLossWhatIsSentArrivesAfterTheDelayAndItsJitter) {
  VirtualLink even({5e-3, 0, 0});
  EXPECT_EQ(even.hands(7), 5'000'007);
  EXPECT_EQ(even.problem(7, 100'000), 5'000'007);
  VirtualLink uneven({5e-3, 2e-3, 0});
  std::int64_t least = INT64_MAX, most = 0;
  for (int k = 0; k < 1000; ++k) {
    const std::int64_t t = uneven.hands(0);
    least = std::min(least, t);
    most = std::max(most, t);
  }
  EXPECT_NEAR(1e-6 * static_cast<double>(least), 3, 0.05);
  EXPECT_NEAR(1e-6 * static_cast<double>(most), 7, 0.05);
}

// Of n datagrams all arrive at once with (1 − p)ⁿ; each round more takes 2 d + 1 ms.
TEST(VirtualLink, LostHandsAreGoneAndLostPartsOfAProblemComeARoundLater) {
  constexpr double p = 0.05;
  VirtualLink link({5e-3, 0, p});
  int lost = 0, at_once = 0, later = 0;
  constexpr int n = 20'000;
  for (int k = 0; k < n; ++k) lost += link.hands(0) < 0;
  EXPECT_NEAR(static_cast<double>(lost) / n, p, 0.01);
  for (int k = 0; k < n; ++k) {
    const std::int64_t t = link.problem(0, 10 * 1400 - 1);
    at_once += t == 5'000'000;
    later += t == 16'000'000;
    EXPECT_EQ((t - 5'000'000) % 11'000'000, 0);
  }
  EXPECT_NEAR(static_cast<double>(at_once) / n, std::pow(1 - p, 10), 0.01);
  EXPECT_NEAR(static_cast<double>(later) / n, std::pow(1 - p * p, 10) - std::pow(1 - p, 10), 0.01);
}

TEST(VirtualLink, OnlyTheNewestThatHasArrivedIsTakenAndWhatItOvertookIsDropped) {
  Underway<int> way;
  int value = 0;
  way.send(30, 1);
  way.send(10, 2);
  way.send(20, 3);
  way.send(-1, 4);
  EXPECT_FALSE(way.take(9, value));
  EXPECT_TRUE(way.take(10, value));
  EXPECT_EQ(value, 2);
  EXPECT_FALSE(way.take(15, value));
  EXPECT_TRUE(way.take(40, value));
  EXPECT_EQ(value, 3);  // 1 came after it and was sent before
  EXPECT_FALSE(way.take(100, value));
}

}  // namespace
}  // namespace hapticd
