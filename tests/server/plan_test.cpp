// The plan of a scene: what nobody can feel is left out, what is pinned stays, what is chosen was measured.
#include "server/plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "server/scene_reader.h"
#include "server/scene_world.h"

namespace hapticd {
namespace {

Scene economy(const std::string& name) {
  return read_scene(std::string(SOURCE_DIR "/config/scenes/economy/") + name + ".yaml");
}

const PlanLine* line_of(const Plan& plan, const std::string& term) {
  const auto found =
      std::find_if(plan.lines.begin(), plan.lines.end(), [&](const PlanLine& l) { return l.term == term; });
  return found == plan.lines.end() ? nullptr : &*found;
}

std::string choice_of(const Plan& plan, const std::string& term) {
  const PlanLine* line = line_of(plan, term);
  return line ? line->choice : "no line";
}

TEST(Plan, APadPressedSlowlyIsLinearAndStatic) {
  const Plan plan = make_plan(economy("static_pad"));
  EXPECT_EQ(choice_of(plan, "pad: elements"), "linear") << describe(plan);
  EXPECT_EQ(choice_of(plan, "pad: motion"), "static") << describe(plan);
  EXPECT_TRUE(plan.met) << describe(plan);
  EXPECT_LE(plan.error_estimate, plan.scene.accuracy);
  EXPECT_FALSE(plan.scene.plans);
}

TEST(Plan, AStripThatTurnsIsCorotational) {
  const Plan plan = make_plan(economy("large_rotation"));
  EXPECT_EQ(choice_of(plan, "strip: elements"), "corotational") << describe(plan);
  EXPECT_TRUE(plan.met) << describe(plan);
}

TEST(Plan, SteelIsRigidAndWhatNobodyReachesIsNotSimulated) {
  const Plan plan = make_plan(economy("everything"));
  EXPECT_EQ(choice_of(plan, "plate"), "rigid") << describe(plan);
  EXPECT_EQ(choice_of(plan, "far"), "not simulated") << describe(plan);
  EXPECT_EQ(choice_of(plan, "tissue: motion"), "dynamic");  // it can be cut
  EXPECT_EQ(choice_of(plan, "friction"), "on") << describe(plan);
  const auto world = make_world(plan.scene);
  EXPECT_FALSE(world->bodies()[2].deformable);
  EXPECT_FALSE(world->bodies()[3].deformable);
}

TEST(Plan, WhatIsPinnedStaysAndIsSaidToBe) {
  Scene scene = economy("static_pad");
  scene.bodies[0].pinned_elements = scene.bodies[0].pinned_motion = scene.pinned_contact = true;
  const Plan plan = make_plan(scene);
  EXPECT_EQ(choice_of(plan, "pad: elements"), "corotational");
  EXPECT_EQ(choice_of(plan, "pad: motion"), "dynamic");
  EXPECT_EQ(line_of(plan, "pad: elements")->reason, "pinned by the scene");
  EXPECT_EQ(plan.scene.contact, Renewal::renewed);
}

// Nothing is chosen where the scene does not ask for it.
TEST(Plan, ASceneWithoutAutoIsMeasuredAndLeftAlone) {
  Scene scene = economy("static_pad");
  scene.plans = false;
  const Plan plan = make_plan(scene);
  EXPECT_TRUE(plan.scene.bodies[0].corotational && plan.scene.bodies[0].dynamic &&
              plan.scene.bodies[0].simulated);
  EXPECT_GT(plan.cost_ms, 0);
}

TEST(Plan, JsonHasALineForEachTerm) {
  const nlohmann::ordered_json json = to_json(make_plan(economy("small_motion")));
  ASSERT_GE(json["plan"].size(), 6u);
  for (const auto& line : json["plan"])
    for (const char* key : {"term", "choice", "reason", "cost_ms", "error_estimate"})
      EXPECT_TRUE(line.contains(key)) << key;
}

}  // namespace
}  // namespace hapticd
