// What a hand feels of a stroke whose forces are known.
#include "server/plan/felt.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

// A millisecond a pose; pressed in along −z to `depth` and drawn along x by `along`, both linearly.
PilotStroke stroke(double depth, double along) {
  PilotStroke s;
  for (int i = 0; i <= 100; ++i) {
    Pose pose;
    pose.p = Vec3(along * i / 100, 0, -depth * i / 100);
    s.pose.push_back(pose);
  }
  return s;
}

TEST(Felt, ASpringIsItsStiffnessHoweverSlantedTheWay) {
  const PilotStroke s = stroke(2e-3, 8e-3);
  TrialRun run;
  for (const Pose& pose : s.pose) run.force.emplace_back(0, 0, 30 * std::max(0.0, -pose.p.z() - 0.5e-3));
  const Felt felt = felt_along(s, run, 1);
  EXPECT_NEAR(felt.peak, 0.045, 1e-12);
  EXPECT_NEAR(felt.stiffness.value(), 30, 1e-9);
}

// Two samples of three are not there: every third millisecond's pose counts.
TEST(Felt, ForcesMayBeFewerThanPoses) {
  const PilotStroke s = stroke(2e-3, 0);
  TrialRun run;
  for (std::size_t i = 0; i < s.pose.size(); i += 3) run.force.emplace_back(0, 0, -30 * s.pose[i].p.z());
  EXPECT_NEAR(felt_along(s, run, 3).stiffness.value(), 30, 1e-9);
}

// Drawn along the surface at one depth, the force is what it is for other reasons.
TEST(Felt, AWayAlongTheSurfaceTellsNoStiffness) {
  const PilotStroke s = stroke(0, 8e-3);
  TrialRun run;
  for (std::size_t i = 0; i < s.pose.size(); ++i) run.force.emplace_back(0, 0, 0.02 + (i % 2 ? 0.005 : 0));
  const Felt felt = felt_along(s, run, 1);
  EXPECT_NEAR(felt.peak, 0.025, 1e-15);
  EXPECT_FALSE(felt.stiffness);
  SceneInstrument held;
  held.device.force_scale = 100;
  held.device.max_force = 3.3;
  EXPECT_EQ(describe(felt, held), "tissue     felt along the stroke: at most 2.5 N (in the scene 0.025 N)\n");
}

TEST(Felt, NothingTouchedIsNothingFelt) {
  TrialRun run;
  run.force.assign(101, Vec3::Zero());
  EXPECT_EQ(felt_along(stroke(1e-3, 0), run, 1).peak, 0);
  EXPECT_EQ(felt_along(stroke(1e-3, 0), {}, 1).peak, 0);
}

}  // namespace
}  // namespace hapticd
