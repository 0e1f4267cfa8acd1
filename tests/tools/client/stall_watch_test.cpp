#include "tools/client/stall_watch.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include "haptic/clock.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

TEST(Stalls, OfSeveralCoresAreUnited) {
  const Stalls stalls({{10 * ms, 12 * ms}, {40 * ms, 41 * ms}, {11 * ms, 15 * ms}, {14 * ms, 14 * ms + 1}});
  EXPECT_EQ(stalls.count(), 2u);
  EXPECT_EQ(stalls.total_ns(), 6 * ms);
  EXPECT_EQ(stalls.longest_ns(), 5 * ms);
  EXPECT_TRUE(stalls.strike(14 * ms, 20 * ms));
  EXPECT_TRUE(stalls.strike(0, 10 * ms + 1));
  EXPECT_FALSE(stalls.strike(0, 10 * ms));
  EXPECT_FALSE(stalls.strike(15 * ms, 40 * ms));
  EXPECT_FALSE(stalls.strike(41 * ms, 90 * ms));
  EXPECT_FALSE(Stalls().strike(0, 90 * ms));
}

// Ten slots; 3 to 5 of them are near a stall from 4.2 to 4.6 ms, and those alone are unanswered.
TEST(Stalls, TakeTheSlotsThatTheyStrike) {
  SlotBook book(10);
  book.begin(100 * ms, 1);
  for (std::int64_t k = 0; k < 10; ++k) {
    book.send(k, book.plan().time_of(k));
    if (k < 3 || k > 5) book.answer(k, book.plan().time_of(k) + ms / 2);
  }
  const Stalls stalls({{104 * ms + ms / 5, 104 * ms + 3 * ms / 5}});
  const SlotCount all = between_stalls(book, Stalls()), between = between_stalls(book, stalls);
  EXPECT_EQ(all.scheduled, 10);
  EXPECT_EQ(all.answered, 7);
  EXPECT_EQ(between.scheduled, 7);
  EXPECT_EQ(between.sent, 7);
  EXPECT_EQ(between.answered, 7);
  EXPECT_EQ(between_stalls(book, stalls, 105 * ms, 107 * ms).scheduled, 1);
}

// What it sees lies within the watch, and it ends.
TEST(StallWatch, SeesNothingFromBeforeOrAfterItself) {
  const std::int64_t begin = monotonic_ns();
  StallWatch watch;
  usleep(50'000);
  const WatchedMachine machine = watch.stop();
  const std::int64_t end = monotonic_ns();
  EXPECT_FALSE(machine.stalls.strike(INT64_MIN, begin));
  EXPECT_FALSE(machine.stalls.strike(end, INT64_MAX));
  EXPECT_LE(machine.last_core_ms, 1e-6 * static_cast<double>(end - begin));
  EXPECT_TRUE(machine.watched || machine.stalls.count() == 0);
}

}  // namespace
}  // namespace hapticd
