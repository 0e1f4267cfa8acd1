// Stations by what they say: lost by silence, ended by good-bye, apart by name; messages are made up.
#include "tools/fleet/fleet.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include <gtest/gtest.h>

#include "haptic/device.h"
#include "tools/fleet/fleet_text.h"

namespace hapticd {
namespace {

constexpr std::int64_t s = 1'000'000'000, ms = 1'000'000;

Origin origin(const std::string& station, std::uint8_t program = 1) {
  Origin of{station, "host", {}};
  of.program[0] = program;
  return of;
}

hapticd_msg_ServerStatus status(std::uint32_t bits, std::uint32_t device = 0) {
  static char scene[] = "cube", refused[] = "";
  hapticd_msg_ServerStatus m{};
  m.device_id = device;
  m.status = bits;
  m.haptic_rate_hz = 1000;
  m.sim_rate_hz = 50;
  m.scene = scene;
  m.refused = refused;
  return m;
}

const Station& only(const Fleet& fleet) { return fleet.stations().begin()->second; }

TEST(Fleet, SilenceOfSevenStatusesIsALoss) {
  Fleet fleet;
  fleet.hear(origin("lab1"), status(0), 10 * s);
  EXPECT_EQ(fleet.look(10 * s), std::vector<std::string>{"lab1"});  // it is new
  EXPECT_EQ(only(fleet).state, StationState::in_use);
  EXPECT_TRUE(fleet.look(10 * s + silence_ns).empty());
  EXPECT_EQ(fleet.look(10 * s + silence_ns + ms), std::vector<std::string>{"lab1"});
  EXPECT_EQ(only(fleet).state, StationState::lost);
  EXPECT_LT(silence_ns + 100 * ms, s);  // shown within a second
  fleet.look(3600 * s);
  EXPECT_EQ(only(fleet).state, StationState::lost);  // for as long as nobody mends it
}

TEST(Fleet, AGoodByeIsNoFaultAndIsForgotten) {
  Fleet fleet;
  fleet.hear(origin("lab1"), status(1), s);
  fleet.look(s);
  fleet.leave(origin("lab1").program);
  fleet.look(2 * s);
  EXPECT_EQ(only(fleet).state, StationState::ended);
  EXPECT_FALSE(only(fleet).faults.empty());
  EXPECT_FALSE(only(fleet).faults.front().severe);
  fleet.look(2 * s + ended_for_ns);
  EXPECT_TRUE(fleet.stations().empty());
}

TEST(Fleet, WhoeverMakesUpNamesAndIdsGetsABoundedPlace) {
  Fleet fleet;
  for (int i = 0; i < 1000; ++i) {
    fleet.hear(origin("made up " + std::to_string(i)), status(0), s + i);
    fleet.hear(origin("made up 0"), status(0, static_cast<std::uint32_t>(i)), s + i);
    hapticd_msg_SceneOperation operation{};
    operation.device_id = static_cast<std::uint32_t>(i);
    fleet.hear(origin("made up 0"), operation, s + i);
  }
  EXPECT_EQ(fleet.stations().size(), most_stations);
  EXPECT_EQ(fleet.stations().at("made up 0").devices.size(), most_devices);
  EXPECT_EQ(fleet.stations().at("made up 0").operations.size(), most_devices);
  EXPECT_EQ(fleet.left_out(), 1000 - most_stations + 2 * (1000 - most_devices));
  // They fall silent: a station that is there has the place of the one that has been gone for longest.
  fleet.look(10 * s);
  fleet.hear(origin("lab1"), status(0), 10 * s);
  EXPECT_TRUE(fleet.stations().contains("lab1"));
  EXPECT_FALSE(fleet.stations().contains("made up 1"));
  EXPECT_EQ(fleet.stations().size(), most_stations);
}

TEST(Fleet, TwoStationsOfOneDeviceStayApart) {
  Fleet fleet;
  fleet.hear(origin("a", 1), status(0), s);
  fleet.hear(origin("b", 2), status(1), s);
  fleet.look(s);
  ASSERT_EQ(fleet.stations().size(), 2u);
  EXPECT_EQ(fleet.stations().at("a").state, StationState::in_use);
  EXPECT_EQ(fleet.stations().at("b").state, StationState::idle);
}

TEST(Fleet, TwoProgramsForOneDeviceOfAStationAreAFault) {
  Fleet fleet;
  fleet.hear(origin("a", 1), status(1), s);
  fleet.hear(origin("a", 2), status(1), s);
  fleet.look(s);
  EXPECT_EQ(only(fleet).state, StationState::fault);
  EXPECT_EQ(only(fleet).faults.front().what, "two programs answer for device 0");
}

TEST(Fleet, AProgramThatTakesTheOthersPlaceReplacesIt) {
  Fleet fleet;
  fleet.hear(origin("a", 1), status(0), s);
  fleet.look(3 * s);
  EXPECT_EQ(only(fleet).state, StationState::lost);
  fleet.hear(origin("a", 2), status(1), 4 * s);
  fleet.look(4 * s);
  EXPECT_EQ(only(fleet).state, StationState::idle);
  EXPECT_EQ(only(fleet).devices.size(), 1u);
  ASSERT_EQ(only(fleet).lines.size(), 1u);  // and the loss stays in its list
  EXPECT_EQ(only(fleet).lines.front().what, "lost");
  EXPECT_EQ(only(fleet).lines.front().until_ns, 4 * s);
}

TEST(Fleet, BitsOfAStatusAreFaultsByTheirNames) {
  Fleet fleet;
  fleet.hear(origin("a"), status(status_disarmed | status_latched | status_conflict), s);
  fleet.look(s);
  ASSERT_EQ(only(fleet).faults.size(), 2u);
  EXPECT_EQ(only(fleet).faults[0].what, "latched");
  EXPECT_TRUE(only(fleet).faults[0].severe);
  EXPECT_EQ(only(fleet).faults[1].what, "conflict");
  fleet.hear(origin("a"), status(status_saturated | status_ramping_up), 2 * s);
  fleet.look(2 * s);
  EXPECT_TRUE(only(fleet).faults.empty());
}

// 50 steps a second by its own counter, whatever it says of itself; an edge, without steps, is not slow.
TEST(Fleet, ARateIsOfTheLastSeconds) {
  Fleet fleet;
  hapticd_msg_ServerHealth health{};
  health.step_period_ms = 20;
  for (int i = 0; i <= 40; ++i) {
    for (const char* station : {"edge", "slow", "well"}) {
      hapticd_msg_ServerStatus m = status(0);
      m.step = std::string(station) == "edge" ? 0 : 100 + (std::string(station) == "slow" ? 2 : 5) * i;
      fleet.hear(origin(station), m, 10 * s + 100 * i * ms);
      fleet.hear(origin(station), health, 10 * s + 100 * i * ms);
    }
    fleet.look(10 * s + 100 * i * ms);
  }
  EXPECT_TRUE(fleet.stations().at("edge").faults.empty());
  EXPECT_TRUE(fleet.stations().at("well").faults.empty());
  ASSERT_EQ(fleet.stations().at("slow").faults.size(), 1u);
  EXPECT_EQ(fleet.stations().at("slow").faults[0].what, "simulation slow");
  EXPECT_EQ(fleet.stations().at("slow").faults[0].detail, "20 Hz");
}

// 100 blocks of 10 ms a message: 10 bins, each its largest. What a lost message had, the next one has.
TEST(Fleet, ATraceHasTheLargestForceOfEachTenth) {
  ForceTrace trace;
  std::vector<float> force(4 * 100, 0.0f);
  for (std::size_t i = 0; i < 100; ++i) force[4 * i + 3] = static_cast<float>(i);
  trace.take(100, force.data(), 100);
  std::vector<float> bins = trace.newest();
  ASSERT_EQ(bins.size(), 10u);
  for (std::size_t b = 0; b < 10; ++b) EXPECT_EQ(bins[b], static_cast<float>(10 * b + 9));
  EXPECT_EQ(trace.last_second(), 99);
  trace.take(300, force.data(), 100);  // one second was missed
  bins = trace.newest();
  ASSERT_EQ(bins.size(), 30u);
  EXPECT_TRUE(std::isnan(bins[15]));
  EXPECT_EQ(bins[29], 99);
  trace.take(100, force.data(), 100);  // a daemon that was started again
  EXPECT_EQ(trace.newest().size(), 10u);
}

TEST(Fleet, TheTableNamesEveryStation) {
  Fleet fleet;
  fleet.hear(origin("lab1", 1), status(0), s);
  fleet.hear(origin("", 2), status(1), s);
  fleet.look(s);
  const std::string table = table_of(fleet, s, 200, false);
  EXPECT_NE(table.find("lab1       in use"), std::string::npos) << table;
  EXPECT_NE(table.find("(no name)  idle"), std::string::npos) << table;
  EXPECT_EQ(table.find('\x1b'), std::string::npos);
  for (std::size_t from = 0, to; (to = table_of(fleet, s, 20, false).find('\n', from)) != std::string::npos;
       from = to + 1)
    EXPECT_LE(to - from, 20u + 4u);  // some characters have two bytes
  const nlohmann::ordered_json j = to_json(fleet, 7, s);
  EXPECT_EQ(j["counts"]["in use"], 1);
  EXPECT_EQ(j["stations"][1]["station"], "lab1");
}

}  // namespace
}  // namespace hapticd
