// The plan of a scene: what nobody can feel is left out, what is pinned stays, what is chosen was measured.
#include "server/plan/plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "server/files/input_error.h"
#include "server/plan/model_trial.h"
#include "server/scene/scene_reader.h"
#include "server/scene/scene_world.h"

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

// As if the steps of these small scenes filled their period.
constexpr PlanOptions scarce{.idle_share = 0};

// A pad's step takes a tenth of its period: what linear elements save, nobody needs.
TEST(Plan, AccuracyIsNotTradedForTimeThatIsIdle) {
  const Plan plan = make_plan(economy("static_pad"), {.idle_share = 100});
  EXPECT_EQ(choice_of(plan, "pad: elements"), "corotational") << describe(plan);
  EXPECT_NE(line_of(plan, "pad: elements")->reason.find("less than half a period"), std::string::npos)
      << describe(plan);
  EXPECT_LT(plan.error_estimate, 0.01) << describe(plan);
  EXPECT_EQ(PlanOptions{}.idle_share, 0.5);
}

// A sawtooth of height A that falls at each swap jumps by A; what is off by as much all the time does not.
TEST(Plan, JumpsAtSwapsAreCounted) {
  constexpr double height = 0.03;
  for (const int every : {1, 4}) {
    std::vector<Vec3> reference, saw, off;
    std::vector<std::uint8_t> swapped;
    for (int i = 0; i < 400; ++i) {
      const Vec3 f(0, 0, 0.01 * i);
      if (i % every == 0) reference.push_back(f);
      saw.push_back(f + Vec3(0, height * (i % 20) / 19.0, 0));
      off.push_back(f + Vec3(0, height / std::sqrt(3), 0));
      swapped.push_back(i % 20 == 0);
    }
    const double peak = reference.back().norm();
    EXPECT_NEAR(swap_jump(reference, every, saw, swapped), height / peak, 1e-12);
    EXPECT_NEAR(swap_jump(reference, every, off, swapped), 0, 1e-12);
    EXPECT_EQ(swap_jump(reference, every, saw, std::vector<std::uint8_t>(400, 0)), 0);
  }
  EXPECT_EQ(felt_error(0.03, 0.01, 0.02), 0.03);
  EXPECT_NEAR(felt_error(0.03, 0.06, 0.02), 0.05, 1e-15);
}

// A press of the cube would do with frozen contact where a tenth of the peak is allowed, and its step has
// time to spare: nothing is saved there.
TEST(Plan, AForceThatJumpsFiftyTimesASecondIsNotChosen) {
  Scene scene = read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml");
  scene.plans = true;
  scene.accuracy = 0.1;
  const Plan plan = make_plan(scene);
  EXPECT_EQ(choice_of(plan, "contact"), "renewed") << describe(plan);
}

TEST(Plan, APadPressedSlowlyIsLinearAndStatic) {
  const Plan plan = make_plan(economy("static_pad"), scarce);
  EXPECT_EQ(choice_of(plan, "pad: elements"), "linear") << describe(plan);
  EXPECT_EQ(choice_of(plan, "pad: motion"), "static") << describe(plan);
  EXPECT_TRUE(plan.met) << describe(plan);
  EXPECT_LE(plan.error_estimate, plan.scene.accuracy);
  EXPECT_FALSE(plan.scene.plans);
}

TEST(Plan, AStripThatTurnsIsCorotational) {
  const Plan plan = make_plan(economy("large_rotation"), scarce);
  EXPECT_EQ(choice_of(plan, "strip: elements"), "corotational") << describe(plan);
  EXPECT_TRUE(plan.met) << describe(plan);
}

TEST(Plan, SteelIsRigidAndWhatNobodyReachesIsNotSimulated) {
  const Plan plan = make_plan(economy("everything"), scarce);
  EXPECT_EQ(choice_of(plan, "plate"), "rigid") << describe(plan);
  EXPECT_EQ(choice_of(plan, "far"), "not simulated") << describe(plan);
  EXPECT_EQ(choice_of(plan, "tissue: motion"), "dynamic");  // it can be cut
  EXPECT_EQ(choice_of(plan, "friction"), "on") << describe(plan);
  const auto world = make_world(plan.scene);
  EXPECT_FALSE(world->bodies()[2].deformable);
  EXPECT_FALSE(world->bodies()[3].deformable);
}

// A mesh in millimetres read as metres, most often.
TEST(Plan, ASceneWhoseTissueNobodyReachesIsRefused) {
  for (const bool plans : {false, true}) {
    Scene scene = read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml");
    scene.plans = plans;
    for (Vec3& x : scene.bodies[0].mesh.nodes) x = 1e3 * x + Vec3(0, 0, -100);
    try {
      make_plan(scene);
      ADD_FAILURE();
    } catch (const InputError& e) {
      EXPECT_EQ(e.key(), "bodies");
      EXPECT_NE(std::string(e.what()).find("mesh_unit: mm"), std::string::npos) << e.what();
    }
  }
}

TEST(Plan, TheLastTissueWithinReachIsNotMadeRigid) {
  Scene scene = read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml");
  scene.plans = true;
  scene.bodies[0].removable = false;
  scene.bodies[0].material.young = 2e11;
  const Plan plan = make_plan(scene);
  EXPECT_TRUE(plan.scene.bodies[0].simulated) << describe(plan);
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
