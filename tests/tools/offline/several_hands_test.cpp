// Offline runs of several instruments in one tissue: one alone is what it is without the others, twins feel
// the same, joint and held forces agree at rest, and each cuts by its own rule.
#include <gtest/gtest.h>

#include <algorithm>

#include "server/scene/scene_reader.h"
#include "tools/offline/offline_run.h"

namespace hapticd {
namespace {

// Onto the cube at (x, y), `depth` deep by 40 ms, and held; the pedal is down from 60 ms on.
Trajectory press_at(double x, double y, double depth) {
  std::vector<TrajectorySample> samples;
  for (int i = 0; i <= 100; ++i) {
    TrajectorySample s;
    s.t = 0.01 * i;
    s.pose.p = Vec3(x, y, 23.5e-3 - (0.5e-3 + depth) * std::min(1.0, s.t / 0.04));
    s.buttons = s.t > 0.06 ? std::uint32_t{pedal_phaco} : 0u;
    samples.push_back(s);
  }
  return make_trajectory(std::move(samples));
}

class SeveralHands : public testing::Test {
 protected:
  Scene scene = read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml");
  OfflineInput input;

  void SetUp() override {
    scene.instruments.push_back(scene.first());
    scene.instruments[1].name = "second";
    scene.instruments[1].device.id = 1;
    input.motion[0] = press_at(-4e-3, 0, 1e-3);
    input.motion[1] = press_at(4e-3, 0, 1e-3);
    input.to = 0.2;
    input.settle = 0.02;
  }
};

TEST_F(SeveralHands, AnInstrumentWithoutAMotionIsAsIfItWereNotInTheScene) {
  input.to = 0.1;
  input.motion[1] = {};
  const OfflineResult both = run_offline(scene, input, {});
  scene.instruments.pop_back();
  const OfflineResult one = run_offline(scene, input, {});
  ASSERT_EQ(both.ticks().size(), one.ticks().size());
  const double peak = one.ticks().back().wrench.norm();
  double apart = 0;
  for (std::size_t i = 0; i < one.ticks().size(); ++i)
    apart = std::max(apart, (both.ticks()[i].wrench - one.ticks()[i].wrench).norm());
  EXPECT_LT(apart, 1e-9 * peak);
  EXPECT_GT(one.ticks().back().wrench[2], 1e-3);
  EXPECT_EQ(both.hands[1].back().wrench, Vec6(Vec6::Zero()));
}

// The order of a scene's list means nothing.
TEST_F(SeveralHands, ExchangedInstrumentsFeelExchangedForces) {
  input.motion[1] = press_at(4e-3, 0, 0.5e-3);
  const OfflineResult a = run_offline(scene, input, {});
  std::swap(input.motion[0], input.motion[1]);
  const OfflineResult b = run_offline(scene, input, {});
  const double peak = a.hands[0].back().wrench.norm();
  EXPECT_GT(peak, 1e-3);
  for (std::size_t i = 0; i < a.ticks().size(); ++i) {
    EXPECT_LT((a.hands[0][i].wrench - b.hands[1][i].wrench).norm(), 1e-6 * peak) << i;
    EXPECT_LT((a.hands[1][i].wrench - b.hands[0][i].wrench).norm(), 1e-6 * peak) << i;
  }
}

// One hand's push yields to the other: two side by side in one gel feel less than one alone. At rest it does
// not matter whether the other's force is solved or held, and both laws hold to rounding.
TEST_F(SeveralHands, AtRestJointAndHeldForcesAreTheReferences) {
  input.to = 0.4;
  const OfflineResult truth = run_reference(scene, input, 1e-3);
  const OfflineResult joint = run_offline(scene, input, {});
  OfflineOptions options;
  options.rendering = Rendering::alone;
  const OfflineResult alone = run_offline(scene, input, options);
  for (const int hand : {0, 1}) {
    const Vec3 f = truth.hands[hand].back().wrench.head<3>();
    EXPECT_GT(f.z(), 1e-3);
    EXPECT_LT((joint.hands[hand].back().wrench.head<3>() - f).norm(), 5e-3 * f.norm());
    EXPECT_LT((alone.hands[hand].back().wrench.head<3>() - f).norm(), 5e-3 * f.norm());
  }
  EXPECT_LT(joint.reciprocity, 1e-9);
  EXPECT_LT(joint.third_law, 1e-12);
  input.motion[1] = {};
  const OfflineResult single = run_offline(scene, input, {});
  EXPECT_GT(single.ticks().back().wrench[2], 1.02 * joint.ticks().back().wrench[2]);
}

// While the other hand pushes on, a force that is held for a step is late, and the joint solve is not.
TEST_F(SeveralHands, WhileTheOtherMovesTheJointSolveIsNearer) {
  input.motion[1] = press_at(4e-3, 0, 3e-3);
  input.to = 0.06;
  const OfflineResult truth = run_reference(scene, input, 1e-3);
  const auto error = [&](Rendering rendering) {
    OfflineOptions options;
    options.rendering = rendering;
    const OfflineResult run = run_offline(scene, input, options);
    double squares = 0;
    for (std::size_t i = 0; i < run.ticks().size(); ++i)
      squares += (run.ticks()[i].wrench - truth.ticks()[i].wrench).head<3>().squaredNorm();
    return std::sqrt(squares);
  };
  EXPECT_LT(error(Rendering::solved), 0.8 * error(Rendering::alone));
  EXPECT_LT(error(Rendering::alone), error(Rendering::held));
}

TEST_F(SeveralHands, EachCutsByItsOwnRuleAndPedal) {
  input.motion[0] = press_at(-4e-3, 0, 2e-3);
  input.motion[1] = press_at(4e-3, 0, 2e-3);
  input.to = 0.3;
  scene.instruments[0].removal.rate = 0;
  const RemovalSchedule of_second = record_removals(scene, input, {});
  ASSERT_FALSE(of_second.empty());
  const SceneBody& cube = scene.bodies[0];
  for (const RemovalEvent& e : of_second) {
    EXPECT_GT(e.t, 0.06) << "before the pedal";
    for (const int t : e.tets) {
      double x = 0;
      for (const int n : cube.mesh.tets[static_cast<std::size_t>(t)])
        x += cube.mesh.nodes[static_cast<std::size_t>(n)].x() / 4;
      EXPECT_GT(x, 0) << "under the first, which destroys nothing";
    }
  }
  scene.instruments[1].removal.rate = 0;
  EXPECT_TRUE(record_removals(scene, input, {}).empty());
}

}  // namespace
}  // namespace hapticd
