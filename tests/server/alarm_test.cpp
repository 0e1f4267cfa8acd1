#include "server/alarm.h"

#include <chrono>
#include <mutex>
#include <vector>

#include <gtest/gtest.h>

#include "haptic/loop.h"

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
};

TEST(AlarmTest, RingsOnceAtATimeAndNotBefore) {
  Rings rings;
  Alarm alarm(ms, [&] { rings.add(); });
  const std::int64_t due = monotonic_ns() + 20 * ms;
  alarm.set(due);
  sleep_until(due + 50 * ms);
  const auto at = rings.seen();
  ASSERT_EQ(at.size(), 1u);
  EXPECT_GE(at[0], due);
}

TEST(AlarmTest, ATimeThatIsMovedOnBeforeItComesDoesNotRing) {
  Rings rings;
  Alarm alarm(ms, [&] { rings.add(); });
  std::int64_t due = 0;
  // Always 30 ms ahead; a thread that the machine holds up for longer has no right to judge.
  for (int i = 0; i < 50; ++i) {
    const std::int64_t now = monotonic_ns();
    if (due > 0 && now > due) GTEST_SKIP() << "the machine stood for " << (now - due) / ms + 30 << " ms";
    alarm.set(due = now + 30 * ms);
    sleep_until(now + ms);
  }
  sleep_until(due + 50 * ms);
  const auto at = rings.seen();
  ASSERT_EQ(at.size(), 1u);
  EXPECT_GE(at[0], due);
}

// What the loop does while nobody sends: each ring sets the next a period later.
TEST(AlarmTest, RingsEachOfTimesAPeriodApart) {
  Rings rings;
  Alarm* self = nullptr;
  const std::int64_t first = monotonic_ns() + 5 * ms;
  std::int64_t due = first;
  Alarm alarm(ms, [&] {
    rings.add();
    self->set(due += ms);
  });
  self = &alarm;
  alarm.set(first);
  sleep_until(first + 200 * ms);
  const auto at = rings.seen();
  EXPECT_GE(at.size(), 190u);
  for (std::size_t i = 0; i < at.size(); ++i) EXPECT_GE(at[i], first + static_cast<std::int64_t>(i) * ms);
}

}  // namespace
}  // namespace hapticd
