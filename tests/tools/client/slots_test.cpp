#include "tools/client/slots.h"

#include "tools/client/common_start.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace hapticd {
namespace {

TEST(Slots, AnOnTimeClientServesTheNextOne) {
  const SlotPlan plan{1000, 1'000'000, 10, 1};
  EXPECT_EQ(plan.slot_to_serve(0, 1000), 0);
  EXPECT_EQ(plan.slot_to_serve(3, plan.time_of(3) + 10), 3);
  EXPECT_EQ(plan.slot_to_serve(0, 0), 0);
}

// The last of three to arrive sets the time, ahead of it.
TEST(CommonStart, BeginsWhenAllHaveArrived) {
  CommonStart start(3);
  start.arrive(1000);
  start.arrive(5000);
  EXPECT_EQ(start.time_ns(), 0);
  start.arrive(3000);
  EXPECT_EQ(start.time_ns(), 3000 + 20'000'000);
}

TEST(Slots, ALateClientSkipsWhatIsOver) {
  const SlotPlan plan{1000, 1'000'000, 10, 1};
  EXPECT_EQ(plan.slot_to_serve(3, plan.time_of(3) + 999'999), 3);
  EXPECT_EQ(plan.slot_to_serve(3, plan.time_of(4)), 4);
  EXPECT_EQ(plan.slot_to_serve(3, plan.time_of(7) + 5), 7);
  EXPECT_EQ(plan.slot_to_serve(3, plan.time_of(50)), 10);
}

// What is skipped stays in the denominator.
TEST(Slots, SkippedAndUnansweredSlotsCountAsScheduled) {
  SlotBook book(5);
  book.begin(0, 100);
  for (const std::int64_t k : {0, 1, 4}) book.send(k, book.plan().time_of(k) + 20'000);
  EXPECT_TRUE(book.answer(book.slot_of(100), 600'000));
  EXPECT_FALSE(book.answer(book.slot_of(100), 1'600'000));  // the daemon had nothing newer
  EXPECT_TRUE(book.answer(book.slot_of(104), 4'700'000));
  EXPECT_EQ(book.scheduled(), 5);
  EXPECT_EQ(book.sent(), 3);
  EXPECT_EQ(book.answered(), 2);
  EXPECT_EQ(book.repeats(), 1);
  ASSERT_EQ(book.round_trip_us().size(), 2u);
  EXPECT_NEAR(book.round_trip_us()[0], 580, 1e-9);
  EXPECT_NEAR(book.intended_round_trip_us()[1], 700, 1e-9);
  EXPECT_EQ(book.lateness_us().size(), 3u);
}

TEST(Slots, NumbersOutsideThePlanAreNobodys) {
  SlotBook book(5);
  book.begin(0, 100);
  EXPECT_EQ(book.slot_of(0), -1);
  EXPECT_EQ(book.slot_of(99), -1);
  EXPECT_EQ(book.slot_of(104), 4);
  EXPECT_EQ(book.slot_of(105), -1);
}

}  // namespace
}  // namespace hapticd
