#include "server/observe/incidents.h"

#include <gtest/gtest.h>

#include "haptic/device.h"

namespace hapticd {
namespace {

constexpr std::int64_t s = 1'000'000'000;

TEST(Incidents, NothingNewSaysNothing) {
  Incidents incidents;
  EXPECT_TRUE(incidents.look(0, {}).empty());
  EXPECT_TRUE(incidents.look(s, {}).empty());
}

TEST(Incidents, ArmedDisarmedAndLatchedAreAlwaysSaid) {
  Incidents incidents;
  incidents.look(0, {.device_id = 3, .status = status_disarmed});
  const auto armed = incidents.look(s, {.device_id = 3, .status = 0});
  ASSERT_EQ(armed.size(), 1u);
  EXPECT_EQ(armed[0].message, "device 3: armed");
  const auto gone = incidents.look(2 * s, {.device_id = 3, .status = status_disarmed | status_latched});
  ASSERT_EQ(gone.size(), 2u);
  EXPECT_EQ(gone[0].event, "disarmed");
  EXPECT_EQ(gone[1].event, "latched");
}

// One whose client let go is no warning.
TEST(Incidents, ASilentClientIsSaidToBeOne) {
  Incidents incidents;
  incidents.look(0, {.device_id = 3, .status = 0});
  const auto silent = incidents.look(s, {.device_id = 3, .status = status_disarmed, .silent = true});
  ASSERT_EQ(silent.size(), 1u);
  EXPECT_EQ(silent[0].level, LogLevel::warning);
  EXPECT_NE(silent[0].message.find("no state of its client came for 100 ms"), std::string::npos);
  incidents.look(2 * s, {.device_id = 3, .status = 0});
  EXPECT_EQ(incidents.look(3 * s, {.device_id = 3, .status = status_disarmed})[0].message,
            "device 3: disarmed");
}

TEST(Incidents, ASecondDaemonIsSaidWhenItIsHeard) {
  Incidents incidents;
  incidents.look(0, {.device_id = 3, .status = 0});
  const auto heard = incidents.look(s, {.device_id = 3, .status = status_rival | status_ramping_down});
  ASSERT_EQ(heard.size(), 1u);
  EXPECT_EQ(heard[0].event, "second_daemon");
  EXPECT_EQ(heard[0].level, LogLevel::error);
  EXPECT_NE(heard[0].message.find("device 3: conflict"), std::string::npos);
  EXPECT_TRUE(incidents.look(2 * s, {.device_id = 3, .status = status_rival | status_ramping_down}).empty());
}

// 4 misses; then 1 a second, in ten seconds said once, with the ten.
TEST(Incidents, AKindComesOnceInTenSecondsWithItsNumber) {
  Incidents incidents;
  LoopCounters c;
  c.deadline_misses = 4;
  const auto first = incidents.look(s, c);
  ASSERT_EQ(first.size(), 1u);
  EXPECT_EQ(first[0].fields["count"], 4);
  for (int i = 2; i <= 10; ++i) {
    ++c.deadline_misses;
    EXPECT_TRUE(incidents.look(i * s, c).empty()) << i;
  }
  ++c.deadline_misses;
  const auto later = incidents.look(11 * s, c);
  ASSERT_EQ(later.size(), 1u);
  EXPECT_EQ(later[0].fields["count"], 10);
  EXPECT_EQ(later[0].fields["total"], 14);
}

TEST(Incidents, DevicesAreCountedApart) {
  Incidents incidents;
  LoopCounters a, b;
  a.refused = 2;
  b.device_id = 1;
  EXPECT_EQ(incidents.look(s, a).size(), 1u);
  EXPECT_TRUE(incidents.look(s, b).empty());
  b.refused = 5;
  EXPECT_EQ(incidents.look(2 * s, b).size(), 1u);
}

}  // namespace
}  // namespace hapticd
