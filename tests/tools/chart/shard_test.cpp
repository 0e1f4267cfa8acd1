// Parts of a run give together what the whole gives: of made-up figures, and of runs in virtual time, byte
// for byte.
#include "tools/chart/shard.h"

#include <gtest/gtest.h>

#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

using Json = nlohmann::ordered_json;

// Seven units; unit k makes k mod 3 squares, and an odd one a word.
Json figures(const Shard& shard) {
  ShardLedger ledger(shard);
  std::vector<int> squares;
  std::vector<std::string> words;
  for (int k = 0; k < 7; ++k) {
    if (!ledger.begins()) continue;
    for (int i = 0; i < k % 3; ++i) squares.push_back(10 * k + i);
    if (k % 2 == 1) words.push_back(std::to_string(k));
    ledger.made("squares", squares.size());
    ledger.made("words", words.size());
  }
  Json json = {{"command", "test"}};
  ledger.prepare(json, {"squares", "words", "none"}, {"words", "none"});
  json["squares"] = squares;
  if (!words.empty()) json["words"] = words;
  json["tail"] = 0.1;
  ledger.note(json);
  return json;
}

std::vector<ShardFile> parts(int n) {
  std::vector<ShardFile> all;
  for (int i = 1; i <= n; ++i) all.push_back({"part" + std::to_string(i), figures({i, n})});
  return all;
}

TEST(Shard, PartsOfAnyNumberAreTheWhole) {
  const std::string whole = figures({}).dump(2);
  EXPECT_EQ(whole.find("shard"), std::string::npos);
  for (int n : {2, 3, 7, 9}) {
    std::vector<ShardFile> all = parts(n);
    std::reverse(all.begin(), all.end());  // in whatever order they come
    EXPECT_EQ(merge_shards(all).dump(2), whole) << n;
  }
}

TEST(Shard, WhatDoesNotBelongTogetherIsRefused) {
  std::vector<ShardFile> all = parts(3);
  all.pop_back();
  EXPECT_THROW(merge_shards(all), InputError);  // one is missing
  all.push_back(all.front());
  EXPECT_THROW(merge_shards(all), InputError);  // one is there twice
  all = parts(3);
  all[1].json["tail"] = 0.2;
  EXPECT_THROW(merge_shards(all), InputError);  // other options
  all[1].json.erase("shard");
  EXPECT_THROW(merge_shards(all), InputError);  // no part
}

TEST(Shard, NamesAPart) {
  EXPECT_EQ(Shard{}.stem("force"), "force");
  EXPECT_EQ((Shard{2, 3}).stem("force"), "force_2of3");
  for (const char* wrong : {"0/3", "4/3", "2", "2/", "/3", "2/3x", "-1/3", "1/0"})
    EXPECT_EQ(run_haptic("stability --shard " + std::string(wrong)).code, 2) << wrong;
}

// One run and its parts, in folders of their own; whether the merged figures have the whole run's bytes.
void expect_same(const std::string& command, const std::string& stem, int n) {
  const ScratchDirectory scratch;
  const std::string one = scratch.file("one"), in_parts = scratch.file("parts");
  std::filesystem::create_directories(one);
  std::filesystem::create_directories(in_parts);
  const CommandResult whole = run_haptic(command + " --json " + one + "/" + stem + ".json");
  for (int i = 1; i <= n; ++i) {
    const std::string part = std::to_string(i) + "/" + std::to_string(n);
    const CommandResult r = run_haptic(command + " --shard " + part + " --out " + in_parts);
    ASSERT_LE(r.code, 1) << r.output;
  }
  const CommandResult merged = run_haptic("chart merge --no-pictures " + in_parts);
  ASSERT_EQ(merged.code, 0) << merged.output;
  ASSERT_LE(whole.code, 1) << whole.output;
  EXPECT_EQ(read_bytes(in_parts + "/" + stem + ".json"), read_bytes(one + "/" + stem + ".json"));
}

TEST(Shard, ModesOfStabilityInTwoAndThreePartsHaveTheBytesOfOneRun) {
  const std::string few = "stability --quick --mode 'packet loss,jitter,random,quantum,friction' --ticks 400";
  expect_same(few, "stability", 2);
  expect_same(few, "stability", 3);
}

TEST(Shard, ChecksOfTissueInThreePartsHaveTheBytesOfOneRun) {
  expect_same("chart tissue --quick --only patch,invariance,derivatives,torsion,hertz", "tissue", 3);
}

// Its times are the machine's; everything that is virtual is the same, the table's too.
TEST(Shard, AForceChartsErrorsAreTheSameInParts) {
  const ScratchDirectory scratch;
  const std::string one = scratch.file("one"), in_parts = scratch.file("parts");
  std::filesystem::create_directories(one);
  const std::string cube = SOURCE_DIR "/config/scenes/cube/";
  const std::string command = "chart force " + cube +
                              "cube.yaml --quick --window 0.05 --only default --trajectory " + cube +
                              "press.csv " SOURCE_DIR "/config/scenes/stroke/stroke.csv";
  ASSERT_EQ(run_haptic(command + " --json " + one + "/force.json --csv " + one + "/force.csv").code, 0);
  for (const char* part : {"1/2", "2/2"}) {
    const CommandResult r = run_haptic(command + " --shard " + part + " --out " + in_parts);
    ASSERT_EQ(r.code, 0) << r.output;
  }
  ASSERT_EQ(run_haptic("chart merge --no-pictures " + in_parts).code, 0);
  Json whole = Json::parse(read_bytes(one + "/force.json")),
       merged = Json::parse(read_bytes(in_parts + "/force.json"));
  ASSERT_EQ(whole["points"].size(), 2u);
  ASSERT_EQ(merged["points"].size(), 2u);
  for (Json* j : {&whole, &merged}) {
    for (Json& p : (*j)["points"])
      for (const char* of_the_clock :
           {"cpu_ms_per_s", "simulation_ms_per_s", "haptic_ms_per_s", "references_ms_per_s",
            "simulation_step_ms_p50", "simulation_step_ms_p99", "haptic_us_p99", "memory_mb", "pareto",
            "front_factor"})
        p.erase(of_the_clock);
    for (Json& r : (*j)["runs"]) r.erase("reference_cpu_s");
  }
  EXPECT_EQ(merged.dump(2), whole.dump(2));
  const std::string table = read_bytes(in_parts + "/force.csv");
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 3);
  EXPECT_EQ(table.substr(0, table.find('\n')), read_bytes(one + "/force.csv").substr(0, table.find('\n')));
}

TEST(Shard, AFolderWithoutPartsIsRefused) {
  const ScratchDirectory scratch;
  EXPECT_EQ(run_haptic("chart merge " + scratch.file("none")).code, 2);
  std::filesystem::create_directories(scratch.file("empty"));
  EXPECT_EQ(run_haptic("chart merge " + scratch.file("empty")).code, 2);
}

}  // namespace
}  // namespace hapticd
