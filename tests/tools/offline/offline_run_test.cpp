// Offline runs: bit-identical twice, equal to the reference at rest, and honest about what was removed.
#include "tools/offline/offline_run.h"

#include <gtest/gtest.h>

#include <map>

#include "server/scene/scene_reader.h"
#include "tools/offline/baseline_rendering.h"

namespace hapticd {
namespace {

// Onto the middle of the cube, 1 mm deep by 40 ms, and held.
OfflineInput press(double to) {
  OfflineInput input;
  std::vector<TrajectorySample> samples;
  for (int i = 0; i <= 100; ++i) {
    TrajectorySample s;
    s.t = 0.01 * i;
    const double down = std::min(1.0, s.t / 0.04);
    s.pose.p = Vec3(10e-3, 10e-3, 23.5e-3 - 1.5e-3 * down);
    samples.push_back(s);
  }
  input.motion = make_trajectory(std::move(samples));
  input.to = to;
  input.settle = 0.02;
  return input;
}

class OfflineRun : public testing::Test {
 protected:
  Scene scene = read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml");

  void SetUp() override {
    double top = 0;
    for (const Vec3& x : scene.bodies[0].mesh.nodes) top = std::max(top, x.z());
    ASSERT_NEAR(top, 20e-3, 1e-3);
  }
};

TEST_F(OfflineRun, TwoRunsAgreeBitForBit) {
  OfflineInput input = press(0.1);
  input.removals = {{0.06, 0, {1, 2, 3}}};
  for (const ComplianceMethod method : {ComplianceMethod::exact, ComplianceMethod::zone}) {
    scene.compliance = method;
    const OfflineResult a = run_offline(scene, input, {}), b = run_offline(scene, input, {});
    ASSERT_EQ(a.ticks().size(), 100u);
    ASSERT_EQ(b.ticks().size(), 100u);
    for (std::size_t i = 0; i < a.ticks().size(); ++i) EXPECT_EQ(a.ticks()[i].wrench, b.ticks()[i].wrench);
    EXPECT_GT(a.ticks()[50].wrench.head<3>().norm(), 1e-3);
  }
}

// At rest neither time nor coupling matters: every rendering that knows the present pose gives one force.
TEST_F(OfflineRun, AtRestEveryRenderingAgreesWithTheReference) {
  const OfflineInput input = press(0.4);
  const Vec3 truth = run_reference(scene, input, 1e-3).ticks().back().wrench.head<3>();
  EXPECT_GT(truth.z(), 1e-3);
  const auto last = [&](const OfflineOptions& options) {
    return Vec3(run_offline(scene, input, options).ticks().back().wrench.head<3>());
  };
  for (const Rendering rendering :
       {Rendering::solved, Rendering::held, Rendering::extrapolated, Rendering::frozen_friction}) {
    OfflineOptions options;
    options.rendering = rendering;
    EXPECT_LT((last(options) - truth).norm(), 5e-3 * truth.norm()) << static_cast<int>(rendering);
  }
  OfflineOptions paper;
  paper.newest_pose = paper.fresh_free_motion = false;
  EXPECT_LT((last(paper) - truth).norm(), 5e-3 * truth.norm());
}

// A window that begins deep in contact has the force that the way down would have given.
TEST_F(OfflineRun, AWindowThatBeginsInContactIsComeDownTo) {
  const OfflineInput whole = press(0.4);
  OfflineInput window = whole;
  window.from = 0.3;
  window.settle = 0.1;
  window.approach = 2e-3;
  const auto in_window = run_offline(scene, window, {}), all = run_offline(scene, whole, {});
  ASSERT_EQ(in_window.ticks().size(), 100u);
  const Vec3 truth = all.ticks().back().wrench.head<3>();
  EXPECT_LT((in_window.ticks().back().wrench.head<3>() - truth).norm(), 1e-2 * truth.norm());
}

TEST_F(OfflineRun, TheScheduleRemovesTheSameEverywhere) {
  OfflineInput input = press(0.12);
  input.removals = {{0.05, 0, {1, 2, 3}}, {0.07, 0, {3, 4}}};
  EXPECT_EQ(run_offline(scene, input, {}).removed, 4);
  EXPECT_EQ(run_reference(scene, input, 1e-3).removed, 4);
}

TEST_F(OfflineRun, ARecordedScheduleIsWhatTheTipDestroys) {
  const RemovalSchedule schedule = record_removals(scene, press(0.2), 2);
  ASSERT_FALSE(schedule.empty());
  for (std::size_t i = 0; i < schedule.size(); ++i) {
    EXPECT_LE(schedule[i].tets.size(), 3u);
    if (i > 0) {
      EXPECT_GT(schedule[i].t, schedule[i - 1].t);
    }
  }
}

// Each element becomes less from when the tip met it until it went, or until the window ended; both loops
// lose the same.
TEST_F(OfflineRun, WhatGoesByDegreesIsRecordedSo) {
  scene.first().removal.gradual = true;
  OfflineInput input = press(0.5);
  input.removals = record_removals(scene, input, 4);
  std::map<int, double> begun;  // by element
  int went = 0;
  for (std::size_t i = 0; i < input.removals.size(); ++i) {
    const RemovalEvent& e = input.removals[i];
    if (i > 0) {
      EXPECT_GE(e.t, input.removals[i - 1].t);
    }
    for (const int t : e.tets) {
      if (e.time > 0) {
        EXPECT_TRUE(begun.emplace(t, e.t).second) << "once";
      } else {
        went += 1;
        ASSERT_TRUE(begun.contains(t));
        EXPECT_GT(e.t, begun[t]);
      }
    }
  }
  EXPECT_GT(went, 0);
  EXPECT_GE(static_cast<int>(begun.size()), went);
  EXPECT_EQ(run_offline(scene, input, {}).removed, went);
  EXPECT_EQ(run_reference(scene, input, 1e-3).removed, went);
}

TEST_F(OfflineRun, AFasterSimulationThanTheHapticLoopIsRefused) {
  scene.rate = 2000;
  EXPECT_THROW(run_offline(scene, press(0.1), {}), std::invalid_argument);
}

}  // namespace
}  // namespace hapticd
