#include "physics/part_times.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

std::int64_t now = 0;
std::int64_t fake_clock() noexcept { return now; }

TEST(PartTimes, TimeGoesToTheInnermostPart) {
  PartTimes times(fake_clock);
  now = 100;
  times.start();
  now += 1;
  {
    const Within outer(&times, StepPart::condense);
    now += 10;
    {
      const Within inner(&times, StepPart::factor);
      now += 100;
    }
    now += 1000;
  }
  now += 10000;
  times.enter(0);
  EXPECT_EQ(times.ns(StepPart::publish), 10001);
  EXPECT_EQ(times.ns(StepPart::condense), 1010);
  EXPECT_EQ(times.ns(StepPart::factor), 100);
  EXPECT_EQ(times.ns(StepPart::solve), 0);
  times.start();
  EXPECT_EQ(times.ns(StepPart::condense), 0);
}

TEST(PartTimes, NobodyAskedCostsNoClock) {
  const std::int64_t before = now;
  { const Within nobody(nullptr, StepPart::solve); }
  EXPECT_EQ(now, before);
}

}  // namespace
}  // namespace hapticd
