#include "tools/stability/bench/closed_loop.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>

#include "server/files/paths.h"
#include "server/scene/scene_reader.h"

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

// The theorem behind the bound: a spring held for T makes K T/2 ∫ v² dt of whatever motion ends where it
// began, and the device takes b ∫ v² dt of it, so the surplus is (b − K T/2) ∫ v² dt, to the sign of b − K
// T/2: just below the bound a wall measures as passive and just above it as active, by that much. What the
// device damps on the way to the wall is no part of it.
TEST(ClosedLoop, EnergyOfASampledSpringIsColgatesTermByTerm) {
  ClosedLoopSettings s = press();
  s.hand.device_damping = 1;
  s.press.hold = 1;
  s.let_go = true;
  // Within the first hold, whole periods of 20 Hz.
  s.sway = [](double t) -> Vec3 {
    return t > 0.4 && t < 1.2 ? Vec3(0, 0, 1e-3 * std::sin(2 * std::numbers::pi * 20 * (t - 0.4)))
                              : Vec3::Zero();
  };
  for (const double share : {0.9, 1.1}) {
    const double K = share * 2 * s.hand.device_damping / 1e-3;
    SpringWall spring = wall(K);
    const ClosedLoopResult r = run_closed_loop(spring, s);
    double v2 = 0;  // ∫ v² dt, within the wall
    for (std::size_t i = 1; i < r.ticks.size(); ++i)
      if (r.ticks[i].force > 0) v2 += std::pow(r.ticks[i].depth - r.ticks[i - 1].depth, 2) / 1e-3;
    const double surplus = (s.hand.device_damping - K * 1e-3 / 2) * v2;
    EXPECT_NEAR(r.surplus_end, surplus, 0.04 * s.hand.device_damping * v2) << share;  // first touch, leaving
    if (share < 1) {
      EXPECT_GE(r.surplus_min, -1e-9);
    } else {
      EXPECT_LT(r.surplus_min, -1e-6);
    }
  }
}

TEST(ClosedLoop, WithTheTankAHandThatIsArmedInsideGetsWhatIsLentAtMost) {
  Scene scene = read_scene(config_directory() / "scenes/cube/cube.yaml");
  DeviceSettings& device = scene.first().device;
  device.max_force = device.max_force_rate = 1e6;
  device.force_scale = 16;
  // Armed inside: the force that rises pushes the hand out, with energy that nobody put in.
  ClosedLoopSettings s = press();
  s.press.start.z() = 19e-3;
  s.press.depth = 0.1e-3;
  DaemonRendererOptions options;
  const auto made = [&](bool tank) {
    options.passivity_control = tank;
    DaemonRenderer renderer(scene, options);
    return -run_closed_loop(renderer, s).energy_min;
  };
  const double without = made(false), with = made(true);
  std::printf("  made %.3f mJ without the tank, %.6f with it\n", 1e3 * without, 1e3 * with);
  EXPECT_GT(without, 1e-4);
  EXPECT_LT(with, 1e-6);
}

// Pressed and let go within one process, the tank has what is given back.
TEST(ClosedLoop, TheTankLeavesAPressAlone) {
  const Scene scene = read_scene(config_directory() / "scenes/cube/cube.yaml");
  ClosedLoopSettings s = press();
  s.let_go = true;
  DaemonRendererOptions options;
  const auto forces = [&](bool tank) {
    options.passivity_control = tank;
    DaemonRenderer renderer(scene, options);
    return run_closed_loop(renderer, s).ticks;
  };
  const std::vector<ClosedLoopTick> without = forces(false), with = forces(true);
  double squares = 0, peak = 0;
  for (std::size_t k = 0; k < with.size(); ++k) {
    squares += std::pow(with[k].force - without[k].force, 2);
    peak = std::max(peak, without[k].force);
  }
  const double rms = std::sqrt(squares / static_cast<double>(with.size())) / peak;
  std::printf("  differs by %.2e RMS of the peak\n", rms);
  EXPECT_LT(rms, 0.01);
}

TEST(ClosedLoop, DaemonStandsWhereTheHeldForceSwingsAndBothAreRepeatableBitForBit) {
  Scene scene = read_scene(config_directory() / "scenes/cube/cube.yaml");
  DeviceSettings& device = scene.first().device;
  device.max_force = device.max_force_rate = 1e6;
  device.force_scale = 16;
  const auto run = [&](Rendering rendering) {
    DaemonRendererOptions options;
    options.rendering = rendering;
    DaemonRenderer daemon(scene, options);
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
