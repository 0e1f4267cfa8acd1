#include "tools/closed_loop.h"

#include <gtest/gtest.h>

#include "server/paths.h"
#include "server/scene_reader.h"

namespace hapticd {
namespace {

ClosedLoopSettings press() {
  ClosedLoopSettings s;
  s.press.start = Vec3(0, 0, 26e-3);
  s.press.depth = 6e-3;
  s.press.speed = 0.02;
  s.press.hold = 0.4;
  s.hand.device_damping = 0.1;
  return s;
}

SpringWall wall(double stiffness, double damping_time = 0) {
  return {Vec3(0, 0, 22e-3), Vec3::UnitZ(), stiffness, damping_time};
}

// At rest the grip's spring and the wall's share the way: x = k_h x_t / (k_h + K), measured at both holds.
TEST(ClosedLoop, HandAndWallAtRestAreTwoSprings) {
  ClosedLoopSettings s = press();
  s.press.hold = 1;
  SpringWall soft = wall(50);
  const ClosedLoopResult r = run_closed_loop(soft, s);
  EXPECT_NEAR(r.stiffness, 50, 0.5);
  EXPECT_LT(r.swing, 2e-6);
  double last = 0;
  for (const ClosedLoopTick& tick : r.ticks)
    if (tick.t < 1.29) last = tick.force;  // end of the first hold
  // Contact 4 mm down; the grip pulls 2 mm further.
  EXPECT_NEAR(last, 300.0 * 50 / 350 * 2e-3, 1e-4);
}

// Colgate and Schenkel: with b ≥ K T/2 a sampled wall without damping of its own makes no energy that the
// device does not take; well beyond what hand and device damp together it diverges.
TEST(ClosedLoop, WallIsPassiveBelowColgatesBoundAndBreaksFarAbove) {
  ClosedLoopSettings s = press();
  s.hand.device_damping = 1;
  SpringWall below = wall(2 * s.hand.device_damping / 1e-3 * 0.95);
  EXPECT_GE(run_closed_loop(below, s).surplus_min, -1e-9);
  s.hand.device_damping = 0.02;
  s.hand.damping = 0.2;
  SpringWall above = wall(2e4);
  const ClosedLoopResult r = run_closed_loop(above, s);
  EXPECT_LT(r.surplus_min, -1e-6);
  EXPECT_GT(r.swing, 1e-4);
}

TEST(ClosedLoop, DaemonStandsWhereTheHeldForceSwingsAndBothAreRepeatableBitForBit) {
  Scene scene = read_scene(config_directory() / "scenes/cube/cube.yaml");
  scene.device.max_force = scene.device.max_force_rate = 1e6;
  scene.device.force_scale = 16;
  const auto run = [&](Rendering rendering) {
    VirtualDaemonOptions options;
    options.rendering = rendering;
    VirtualDaemon daemon(scene, options);
    return run_closed_loop(daemon, press());
  };
  const ClosedLoopResult ours = run(Rendering::solved), held = run(Rendering::held),
                         again = run(Rendering::solved);
  EXPECT_LT(ours.swing, 20e-6);
  EXPECT_GE(ours.surplus_min, -1e-9);
  EXPECT_GT(held.swing, 1e-3);
  ASSERT_EQ(ours.ticks.size(), again.ticks.size());
  for (std::size_t i = 0; i < ours.ticks.size(); ++i)
    ASSERT_EQ(ours.ticks[i].force, again.ticks[i].force) << i;
}

// What a renderer gets to see of the states: 0 where none came.
class Seen final : public Renderer {
 public:
  std::vector<std::uint64_t> numbers;
  ForceSample tick(const DeviceSample* arrived) override {
    numbers.push_back(arrived ? arrived->sequence : 0);
    return {};
  }
};

std::vector<std::uint64_t> seen(const ClosedLoopSettings& s) {
  Seen renderer;
  run_closed_loop(renderer, s);
  renderer.numbers.resize(8);
  return renderer.numbers;
}

// States are numbered from 1 and sent one a tick.
TEST(ClosedLoop, NetworkDelaysLosesAndReorders) {
  using Numbers = std::vector<std::uint64_t>;
  ClosedLoopSettings s = press();
  EXPECT_EQ(seen(s), (Numbers{1, 2, 3, 4, 5, 6, 7, 8}));
  s.underway = [](std::int64_t) { return 2; };
  EXPECT_EQ(seen(s), (Numbers{0, 0, 1, 2, 3, 4, 5, 6}));
  s.underway = [](std::int64_t i) { return i % 2 ? -1 : 0; };
  EXPECT_EQ(seen(s), (Numbers{1, 0, 3, 0, 5, 0, 7, 0}));
  // Each first of three comes after the second; of two in one tick the later sent is seen.
  s.underway = [](std::int64_t i) { return i % 3 ? 0 : 2; };
  EXPECT_EQ(seen(s), (Numbers{0, 2, 3, 0, 5, 6, 0, 8}));
  s.renumbered = true;
  s.underway = [](std::int64_t i) { return i % 4 ? 0 : 1; };
  EXPECT_EQ(seen(s), (Numbers{0, 1, 2, 3, 0, 4, 5, 6}));
}

// A torsion spring of the renderer's and the hand's own, no target turned: what was turned comes back, and
// the renderer, having only stored, ends with what it took in.
class Torsion final : public Renderer {
 public:
  ForceSample tick(const DeviceSample* arrived) override {
    ForceSample answer;
    const Eigen::AngleAxisd turn(arrived->pose.q);
    answer.torque = Vec3(0, 0, 1e-2) - 0.1 * turn.angle() * turn.axis();
    return answer;
  }
};

TEST(ClosedLoop, HandTurnsUntilTorquesBalance) {
  ClosedLoopSettings s = press();
  HandSettings turning;
  turning.mass = 1e-4;
  turning.stiffness = 0.3;
  turning.damping = 5e-3;
  turning.device_damping = 0;
  s.turning = turning;
  Torsion renderer;
  const ClosedLoopResult r = run_closed_loop(renderer, s);
  EXPECT_NEAR(r.ticks.back().turn, 1e-2 / 0.4, 1e-6);
  EXPECT_NEAR(r.ticks.back().torque, 1e-2 * 0.3 / 0.4, 1e-6);
  EXPECT_LT(r.turning, 1e-6);
}

}  // namespace
}  // namespace hapticd
