#include "server/os/wakeup_timer.h"

#include <chrono>
#include <mutex>
#include <vector>

#include <gtest/gtest.h>

#include "haptic/clock.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

struct Rings {
  std::mutex mutex;
  std::vector<std::int64_t> at;
  void add() {
    const std::lock_guard<std::mutex> lock(mutex);
    at.push_back(monotonic_ns());
  }
  std::vector<std::int64_t> seen() {
    const std::lock_guard<std::mutex> lock(mutex);
    return at;
  }
  // As soon as there are so many; a busy machine may take its time.
  std::vector<std::int64_t> wait_for(std::size_t count) {
    const std::int64_t until = monotonic_ns() + 10'000 * ms;
    while (seen().size() < count && monotonic_ns() < until) sleep_until(monotonic_ns() + ms);
    return seen();
  }
};

TEST(WakeupTimerTest, RingsOnceAtATimeAndNotBefore) {
  Rings rings;
  WakeupTimer wakeup_timer(ms, [&] { rings.add(); });
  const std::int64_t due = monotonic_ns() + 20 * ms;
  wakeup_timer.set(due);
  rings.wait_for(1);
  sleep_until(monotonic_ns() + 20 * ms);
  const auto at = rings.seen();
  ASSERT_EQ(at.size(), 1u);
  EXPECT_GE(at[0], due);
}

TEST(WakeupTimerTest, ATimeThatIsMovedOnBeforeItComesDoesNotRing) {
  Rings rings;
  WakeupTimer wakeup_timer(ms, [&] { rings.add(); });
  std::int64_t due = 0;
  // Always 30 ms ahead; a thread that the machine holds up for longer has no right to judge.
  for (int i = 0; i < 50; ++i) {
    const std::int64_t now = monotonic_ns();
    if (due > 0 && now > due) GTEST_SKIP() << "the machine stood for " << (now - due) / ms + 30 << " ms";
    wakeup_timer.set(due = now + 30 * ms);
    sleep_until(now + ms);
  }
  const auto at = rings.wait_for(1);
  ASSERT_EQ(at.size(), 1u);
  EXPECT_GE(at[0], due);
}

// What the loop does while nobody sends: each ring sets the next a period later.
TEST(WakeupTimerTest, RingsEachOfTimesAPeriodApart) {
  Rings rings;
  WakeupTimer* self = nullptr;
  const std::int64_t first = monotonic_ns() + 5 * ms;
  std::int64_t due = first;
  WakeupTimer wakeup_timer(ms, [&] {
    rings.add();
    self->set(due += ms);
  });
  self = &wakeup_timer;
  wakeup_timer.set(first);
  const auto at = rings.wait_for(100);
  ASSERT_GE(at.size(), 100u);
  for (std::size_t i = 0; i < at.size(); ++i) EXPECT_GE(at[i], first + static_cast<std::int64_t>(i) * ms);
}

}  // namespace
}  // namespace hapticd
