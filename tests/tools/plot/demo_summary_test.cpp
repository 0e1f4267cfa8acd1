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
          {"slots_scheduled", 1000},
          {"slots_sent", 999},
          {"sim_rate_hz", 49.9},
          {"sim_step_ms", quantile(8)},
          {"solve_us", quantile(50)},
          {"wake_us", quantile(20)},
          {"elements_removed", 60},
          {"fragments_aspirated", 1},
          {"penetration_max_um", 30},
          {"solver_caps", 9},
          {"operation",
           {{"hands", json::array({{{"path_m", 0.04}}})},
            {"bodies",
             {{{"name", "cornea"}},
              {{"name", "capsule"},
               {"volume_gone_share", 0.5},
               {"volume_gone_mm3", 1},
               {"pieces_most", 1},
               {"crumbs", 0},
               {"pieces_loose", 0}},
              {{"name", "lens"},
               {"volume_gone_share", 0.25},
               {"volume_gone_mm3", 40},
               {"pieces_most", 4},
               {"crumbs", 3},
               {"pieces_loose", 2}}}}}}};
}
json good_replay() {
  return {{"force_peak_n", 0.5},
          {"slots_scheduled", 1000},
          {"slots_sent", 999},
          {"slots_answered", 995},
          {"answered_between_stalls", 0.995},
          {"machine_stalls",
           {{"watched", true}, {"count", 0}, {"total_ms", 0}, {"longest_ms", 0}, {"last_core_ms", 0}}},
          {"rtt_us", quantile(700)},
          {"state_age_us", quantile(500)},
          {"contact_share", 0.6},
          {"status_seen_text", "none"},
          {"duration_s", 1}};
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
        "force_peak_n", "penetration_max_um", "slots_scheduled", "slots_sent", "slots_answered",
        "haptic_rate_between_stalls_hz", "answered_between_stalls", "pieces_max", "volume_gone_share",
        "pieces_left_loose", "solver_cap_share"})
    EXPECT_TRUE(v.summary[key].is_number()) << key;
  EXPECT_EQ(v.summary["pieces_max"], 4) << "of the body that lost most";
  EXPECT_EQ(v.summary["volume_gone_share"], 0.25);
  EXPECT_EQ(v.summary["pieces_left_loose"], 2);
  EXPECT_EQ(v.summary["crumbs_left"], 3);
  EXPECT_NEAR(v.summary["solver_cap_share"].get<double>(), 9.0 / 999, 1e-12);
  EXPECT_EQ(v.summary["hands"].size(), 1u);
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
  for (const auto& [key, bad] : {std::pair("sim_rate_hz", 48.9), std::pair("elements_removed", 49.0)}) {
    json daemon = good_daemon();
    daemon[key] = bad;
    expect_named(judge(daemon, good_replay()), key);
  }
  json daemon = good_daemon();
  daemon["slots_sent"] = 998;
  expect_named(judge(daemon, good_replay()), "haptic_rate_between_stalls_hz");
  json replay = good_replay();
  replay["answered_between_stalls"] = 0.989;
  expect_named(judge(good_daemon(), replay), "answered_between_stalls");
}

// 30 of 1000 ticks are lost and the machine stood still for 29.5 ms: no fault of the program. Had its haptic
// core stood still for 10 ms, 20 ticks would be.
TEST(DemoSummary, WhatAStallOfTheMachineTookIsNotTheProgramsFault) {
  json daemon = good_daemon(), replay = good_replay();
  daemon["slots_sent"] = 970;
  daemon["haptic_rate_hz"] = 970;
  replay["machine_stalls"] = {
      {"watched", true}, {"count", 3}, {"total_ms", 29.5}, {"longest_ms", 20}, {"last_core_ms", 29.5}};
  const Verdict excused = judge(daemon, replay);
  EXPECT_EQ(excused.result.code, 0) << excused.result.output;
  EXPECT_NE(excused.result.output.find("the machine itself stood still 3 times"), std::string::npos);
  EXPECT_NEAR(excused.summary["haptic_rate_between_stalls_hz"], 999.485, 1e-3);
  EXPECT_EQ(excused.summary["haptic_rate_hz"], 970);
  replay["machine_stalls"]["last_core_ms"] = 10;
  EXPECT_EQ(judge(daemon, replay).result.code, 1);
  // And one that stands still most of the time is no place to judge on.
  replay["machine_stalls"]["last_core_ms"] = replay["machine_stalls"]["total_ms"] = 60;
  const Verdict unfit = judge(daemon, replay);
  EXPECT_EQ(unfit.result.code, 1);
  EXPECT_NE(unfit.result.output.find("judge it on a quieter one"), std::string::npos) << unfit.result.output;
}

TEST(DemoSummary, AMissingFigureIsAnInputError) {
  json daemon = good_daemon();
  daemon.erase("solve_us");
  const Verdict v = judge(daemon, good_replay());
  EXPECT_EQ(v.result.code, 2);
  EXPECT_NE(v.result.output.find("solve_us"), std::string::npos) << v.result.output;
}

// Two hands: the worst of the answers, the largest force, all slots; and an operation that is to be complete.
TEST(DemoSummary, OfTwoHandsTheOperationIsJudgedToo) {
  json hand = good_replay();
  hand["instrument"] = "phaco";
  json other = hand;
  other["instrument"] = "chopper";
  other["force_peak_n"] = 0.9;
  other["answered_between_stalls"] = 0.992;
  const json replay = {{"devices", {hand, other}}};
  json daemon = good_daemon();
  daemon["operation"]["hands"].push_back({{"path_m", 0.01}});
  for (json& body : daemon["operation"]["bodies"]) body["pieces_loose"] = 0;
  json& lens = daemon["operation"]["bodies"][2];
  lens["volume_gone_share"] = 0.95;
  Verdict v = judge(daemon, replay);
  EXPECT_EQ(v.result.code, 0) << v.result.output;
  EXPECT_NE(v.result.output.find("not kept: overlap_um_max is 30"), std::string::npos) << v.result.output;
  EXPECT_EQ(v.result.output.find("all as it should be"), std::string::npos);
  EXPECT_EQ(v.summary["force_peak_n"], 0.9);
  EXPECT_EQ(v.summary["answered_between_stalls"], 0.992);
  EXPECT_EQ(v.summary["slots_answered"], 2 * 995);
  EXPECT_EQ(v.summary["hands"][1]["instrument"], "chopper");
  EXPECT_EQ(v.summary["hands"][1]["path_m"], 0.01);

  const auto fails = [&](json changed, const char* figure) {
    v = judge(changed, replay);
    EXPECT_EQ(v.result.code, 1) << figure;
    EXPECT_NE(v.result.output.find(std::string("demo: ") + figure + " is "), std::string::npos)
        << v.result.output;
  };
  json bad = daemon;
  bad["operation"]["bodies"][2]["volume_gone_share"] = 0.8;
  fails(bad, "volume_gone_share");
  bad = daemon;
  bad["operation"]["bodies"][2]["pieces_most"] = 3;
  fails(bad, "pieces_max");
  bad = daemon;
  bad["operation"]["bodies"][2]["pieces_loose"] = 1;
  fails(bad, "pieces_left_loose");
  bad = daemon;
  bad["operation"]["events"] = {{{"time_s", 1}, {"what", "rupture"}, {"who", "capsule"}, {"value", 1}}};
  fails(bad, "capsule_ruptures");
}

}  // namespace
}  // namespace hapticd
