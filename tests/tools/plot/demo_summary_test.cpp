// The demonstration's verdict, on made-up figures.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

using nlohmann::json;

json quantile(double scale) {
  return {{"p50", scale}, {"p99", 2 * scale}, {"p99_9", 3 * scale}, {"max", 4 * scale}};
}

json good_daemon() {
  return {{"scene", "x"},
          {"haptic_rate_hz", 999.9},
          {"haptic_deadline_misses", 2},
          {"sim_rate_hz", 49.9},
          {"sim_step_ms", quantile(8)},
          {"solve_us", quantile(50)},
          {"wake_us", quantile(20)},
          {"elements_removed", 60},
          {"fragments_aspirated", 1},
          {"penetration_max_um", 30}};
}
json good_replay() {
  return {{"force_peak_n", 0.5},   {"slots_scheduled", 1000},    {"slots_sent", 999},
          {"slots_answered", 995}, {"rtt_us", quantile(700)},    {"state_age_us", quantile(500)},
          {"contact_share", 0.6},  {"status_seen_text", "none"}, {"duration_s", 1}};
}

struct Verdict {
  CommandResult result;
  json summary;
};
Verdict judge(const json& daemon, const json& replay) {
  const ScratchDirectory scratch;
  std::ofstream(scratch.file("daemon.json")) << daemon;
  std::ofstream(scratch.file("replay.json")) << replay;
  Verdict v;
  v.result = run_command("/usr/bin/python3 " SOURCE_DIR "/tools/plot/demo_summary.py " + scratch.file(""));
  std::ifstream in(scratch.file("summary.json"));
  if (in) v.summary = json::parse(in);
  return v;
}

TEST(DemoSummary, HasEveryFigureThatIsAskedFor) {
  const Verdict v = judge(good_daemon(), good_replay());
  EXPECT_EQ(v.result.code, 0) << v.result.output;
  for (const char* key :
       {"haptic_rate_hz", "haptic_deadline_misses", "sim_rate_hz", "elements_removed", "fragments_aspirated",
        "force_peak_n", "penetration_max_um", "slots_scheduled", "slots_sent", "slots_answered"})
    EXPECT_TRUE(v.summary[key].is_number()) << key;
  for (const char* key : {"p50", "p99", "max"}) EXPECT_TRUE(v.summary["sim_step_ms"][key].is_number());
  for (const char* key : {"p50", "p99", "p99_9", "max"}) {
    EXPECT_TRUE(v.summary["solve_us"][key].is_number());
    EXPECT_TRUE(v.summary["wake_us"][key].is_number());
  }
  EXPECT_EQ(v.summary["slots_answered"], 995);
}

TEST(DemoSummary, NamesEachFigureThatFails) {
  const auto expect_named = [](const Verdict& v, const char* figure) {
    EXPECT_EQ(v.result.code, 1) << v.result.output;
    EXPECT_NE(v.result.output.find(std::string("demo: ") + figure + " is "), std::string::npos)
        << v.result.output;
  };
  for (const auto& [key, bad] : {std::pair("haptic_rate_hz", 998.9), std::pair("sim_rate_hz", 48.9),
                                 std::pair("elements_removed", 49.0)}) {
    json daemon = good_daemon();
    daemon[key] = bad;
    expect_named(judge(daemon, good_replay()), key);
  }
  json replay = good_replay();
  replay["slots_answered"] = 989;
  expect_named(judge(good_daemon(), replay), "slots_answered");
}

TEST(DemoSummary, AMissingFigureIsAnInputError) {
  json daemon = good_daemon();
  daemon.erase("solve_us");
  const Verdict v = judge(daemon, good_replay());
  EXPECT_EQ(v.result.code, 2);
  EXPECT_NE(v.result.output.find("solve_us"), std::string::npos) << v.result.output;
}

}  // namespace
}  // namespace hapticd
