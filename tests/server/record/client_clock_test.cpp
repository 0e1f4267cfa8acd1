// A client's stamps on this machine's clock.
#include "server/record/client_clock.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

TEST(ClientClock, KeepsTheClientsOwnDifferencesWhateverIsLate) {
  std::mt19937 random(3);
  std::uniform_int_distribution<std::int64_t> late(0, 300 * ms);
  ClientClock clock;
  const std::int64_t first = clock.stamp(1, 40 * ms, 5'000 * ms);
  EXPECT_EQ(first, 5'000 * ms);
  for (int k = 1; k < 1000; ++k)
    EXPECT_EQ(clock.stamp(static_cast<std::uint64_t>(k + 1), (40 + k) * ms, (5'000 + k) * ms + late(random)),
              first + k * ms);
}

TEST(ClientClock, AClientThatStartsAgainIsMappedAgain) {
  ClientClock clock;
  EXPECT_EQ(clock.stamp(7, 900 * ms, 1'000 * ms), 1'000 * ms);
  // By its number, by its time, by a clock that was set.
  EXPECT_EQ(clock.stamp(1, 950 * ms, 1'100 * ms), 1'100 * ms);
  EXPECT_EQ(clock.stamp(2, 951 * ms, 1'109 * ms), 1'101 * ms);
  EXPECT_EQ(clock.stamp(3, 5 * ms, 1'200 * ms), 1'200 * ms);
  EXPECT_EQ(clock.stamp(4, 6 * ms, 1'201 * ms), 1'201 * ms);
  EXPECT_EQ(clock.stamp(5, 3'000'006 * ms, 1'202 * ms), 1'202 * ms);
}

TEST(ClientClock, AClientWithoutAClockIsStampedOnArrivalAndStampsRise) {
  ClientClock clock;
  for (int k = 0; k < 5; ++k)
    EXPECT_EQ(clock.stamp(static_cast<std::uint64_t>(k), 0, 100 * ms + 3 * k), 100 * ms + 3 * k);
  const std::int64_t same = clock.stamp(9, 0, 200 * ms);
  EXPECT_EQ(clock.stamp(10, 0, 200 * ms), same + 1);
  std::int64_t last = same + 1;
  for (const std::int64_t time : {std::numeric_limits<std::int64_t>::max(), std::int64_t{-5},
                                  std::numeric_limits<std::int64_t>::min()}) {
    const std::int64_t stamp = clock.stamp(11, time, 201 * ms);
    EXPECT_GT(stamp, last);
    EXPECT_LT(stamp, 202 * ms);
    last = stamp;
  }
}

}  // namespace
}  // namespace hapticd
