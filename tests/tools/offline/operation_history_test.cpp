// Runs that begin where an operation is: bodies as it left them, and pumps that draw.
#include "tools/offline/operation_history.h"

#include <gtest/gtest.h>

#include <numbers>

#include "server/scene/scene_reader.h"
#include "tools/chart/force/force_motion.h"
#include "tools/offline/reference_cache.h"

namespace hapticd {
namespace {

class OperationHistory : public testing::Test {
 protected:
  Scene scene = read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml");
  double begin = along_trajectories(scene, "").from;
};

// Nothing has happened before the recordings begin, so such a window is one without a history.
TEST_F(OperationHistory, OfNoLengthIsNone) {
  const std::vector<BodyStarts> starts = bodies_along_trajectories(scene, {begin, begin - 1});
  ASSERT_EQ(starts.size(), 2u);
  for (const BodyStarts& at : starts)
    for (const auto& body : at) EXPECT_EQ(body, nullptr);
  ForceWindow window{"first", begin, begin + 0.05, true, false};
  const OfflineResult without = run_offline(scene, motions_in_window(scene, window), {});
  window.history = true;
  const OfflineResult with = run_offline(begun_from(scene, starts[0]), motions_in_window(scene, window), {});
  ASSERT_EQ(with.ticks().size(), without.ticks().size());
  for (std::size_t i = 0; i < with.ticks().size(); ++i)
    ASSERT_EQ(with.ticks()[i].wrench, without.ticks()[i].wrench) << i;
}

// A run that begins in the middle, in contact, soon has the force of one that came all the way.
TEST_F(OperationHistory, ARunGoesOnFromIt) {
  OfflineInput whole = along_trajectories(scene, "");
  whole.to = whole.from + 2.4;
  OfflineInput part = whole;
  part.from = whole.to - 0.2;
  part.settle = 0.2;
  part.leads_in = true;
  const std::vector<BodyStarts> starts = bodies_along_trajectories(scene, {part.from - part.settle});
  ASSERT_EQ(starts.size(), 1u);
  ASSERT_NE(starts[0][0], nullptr);
  EXPECT_NE(reference_key(scene, part, 1e-3), reference_key(begun_from(scene, starts[0]), part, 1e-3));
  double moved = 0;
  for (std::size_t n = 0; n < scene.bodies[0].mesh.nodes.size(); ++n)
    moved = std::max(moved, (starts[0][0]->state.x[n] - scene.bodies[0].mesh.nodes[n]).norm());
  EXPECT_GT(moved, 1e-4) << "the tip is in the tissue there";
  const OfflineResult all = run_offline(scene, whole, {}),
                      begun = run_offline(begun_from(scene, starts[0]), part, {});
  ASSERT_EQ(begun.ticks().size(), 200u);
  double peak = 0, most = 0;
  for (std::size_t i = 0; i < 200; ++i) {
    const Vec6 &a = all.ticks()[all.ticks().size() - 200 + i].wrench, &b = begun.ticks()[i].wrench;
    peak = std::max(peak, a.head<3>().norm());
    most = std::max(most, (a - b).head<3>().norm());
  }
  EXPECT_GT(peak, 1e-3);
  EXPECT_LT(most, 0.02 * peak);
}

// A port that hovers over the surface is drawn to it by what its vacuum bears on, in every rendering.
TEST_F(OperationHistory, PumpsDrawInRunsAndInTheReference) {
  Port& port = scene.first().shape.port;
  const double tip = scene.first().shape.primitives[0].radius;
  port = {Vec3(0, 0, -tip), -Vec3::UnitZ(), tip, 1e-3, 300, 0.02};
  double top = 0;
  for (const Vec3& x : scene.bodies[0].mesh.nodes) top = std::max(top, x.z());
  std::vector<TrajectorySample> samples(2);
  for (int i = 0; i < 2; ++i) {
    samples[i].t = i;
    samples[i].pose.p = Vec3(0, 0, top + tip + 0.2e-3);
    samples[i].buttons = pedal_aspiration;
  }
  OfflineInput input;
  input.motion = make_trajectory(samples);
  input.to = 0.5;
  input.settle = 0.02;
  EXPECT_EQ(run_reference(scene, input, 1e-3).ticks().back().wrench, Vec6(Vec6::Zero()));
  input.pedals = Pedals::suction;
  const double truth = run_reference(scene, input, 1e-3).ticks().back().wrench[2];
  EXPECT_LT(truth, -0.1 * port.vacuum * std::numbers::pi * tip * tip);
  for (const Rendering rendering : {Rendering::solved, Rendering::held}) {
    OfflineOptions options;
    options.rendering = rendering;
    const OfflineResult run = run_offline(scene, input, options);
    EXPECT_NEAR(run.ticks().back().wrench[2], truth, -5e-3 * truth) << static_cast<int>(rendering);
    EXPECT_EQ(run.removed, 0);
  }
}

}  // namespace
}  // namespace hapticd
