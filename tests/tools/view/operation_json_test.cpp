#include "tools/view/operation_json.h"

#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "server/observe/operation_message.h"

namespace hapticd {
namespace {

std::vector<std::string> keys_of(const nlohmann::ordered_json& json) {
  std::vector<std::string> keys;
  for (const auto& [key, value] : json.items()) keys.push_back(key);
  return keys;
}

// Who reads the daemon's figures reads a viewer's: the same keys, and a body's loss as a share of its volume.
TEST(OperationJson, HasTheKeysOfTheDaemonsOwnFigures) {
  OperationMeasures m{.time = 12.5,
                      .hands = {{0.3, 4, 2, 1, 0.5, 2500}},
                      .bodies = {},
                      .events = {{3.5, "pieces", "lens", 2}}};
  m.bodies.push_back({.name = "lens", .deformable = true, .volume = 2e-7, .volume_gone = 5e-8, .pieces = 4});
  m.bodies.push_back({.name = "cornea", .touched = 1.5, .touch_most = 0.25});
  std::vector<hapticd_msg_HandOperation> hands;
  std::vector<hapticd_msg_BodyOperation> bodies;
  const std::string scene = "phaco";
  const auto said = operation_json(operation_message(3, scene, m, 17, hands, bodies));
  auto own = to_json(m);
  for (auto& body : own["bodies"]) body.erase("volume_gone_mm3");
  EXPECT_EQ(keys_of(said["hands"][0]), keys_of(own["hands"][0]));
  EXPECT_EQ(keys_of(said["bodies"][0]), keys_of(own["bodies"][0]));
  EXPECT_EQ(keys_of(said["bodies"][1]), keys_of(own["bodies"][1]));
  EXPECT_EQ(said["time_s"], 12.5);
  EXPECT_EQ(said["hands"][0]["vacuum_pa"], 2500);
  EXPECT_EQ(said["bodies"][0]["volume_gone_share"], 0.25);
  EXPECT_EQ(said["bodies"][1]["touch_most_n"], 0.25);
  EXPECT_EQ(said["events"], 17);
  EXPECT_EQ(said["newest_event"]["what"], "pieces");
  EXPECT_EQ(said["newest_event"]["t"], 3.5);
}

// A daemon that lies or is broken: the page has null, and the text stays JSON.
TEST(OperationJson, WhatIsNotFiniteIsNull) {
  hapticd_msg_SceneOperation m{};
  m.time = std::nan("");
  const auto said = operation_json(m);
  EXPECT_TRUE(said["time_s"].is_null());
  EXPECT_EQ(said["scene"], "");
  EXPECT_FALSE(said.contains("newest_event"));
}

}  // namespace
}  // namespace hapticd
