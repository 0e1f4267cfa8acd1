// Modes of the tool: strokes so fast that a simulation step does not see them, a tool wedged between two
// bodies, and two bodies of which one is far stiffer.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "tools/stability/stability_plans.h"

namespace hapticd {

namespace {

constexpr double gap = 3e-3;    // between the two cubes, narrower than stick and ball [m]
constexpr double top = 20e-3;   // of the cubes [m]
constexpr double grip = 30e-3;  // a hand's fingers hold a stylus this far from its middle [m]

// The cube twice, side by side, and the ball on its stick in front of what is between them.
Scene two_cubes(const Scene& cube, double stiffer) {
  Scene scene = cube;
  const SceneBody body = scene.bodies.front();
  scene.bodies.assign(2, body);
  for (int side = 0; side < 2; ++side) {
    SceneBody& b = scene.bodies[static_cast<std::size_t>(side)];
    b.friction = 0.3;
    b.removable = false;
    double half = 0;
    for (const Vec3& x : b.mesh.nodes) half = std::max(half, x.x());
    for (Vec3& x : b.mesh.nodes) x.x() += (side == 0 ? -1 : 1) * (half + 0.5 * gap);
  }
  scene.bodies[1].name = "other";
  scene.bodies[1].material.young *= stiffer;
  return scene;
}

}  // namespace

// The hand strikes at the cube and stays: what it feels then is what it would have after a slow press.
StabilityPlan plan_fast_stroke(StabilityBench& bench, bool quick) {
  StabilityPlan plan;
  plan.parameter = "speed of a stroke into the cube [m/s]; the alarm distance is 0.25 m/s for a step";
  plan.naive = "rows frozen for a simulation step, as in the paper";
  plan.ours = "the daemon";
  plan.judged = "force at rest off that of a slow press [%]";
  plan.limit = 10;
  plan.reason = "0.5 m/s: a quick hand, twice what the alarm distance was chosen for";
  plan.required = 0.5;
  plan.values =
      quick ? std::vector<double>{0.5, 2 * std::numbers::sqrt2} : geometric(0.125, 8, std::numbers::sqrt2);
  const auto run = [&bench](double speed, Renewal contact) {
    ClosedLoopSettings s = bench.press();
    s.press.start = Vec3(0, 0, 83e-3);
    s.press.depth = 68e-3;  // 8 mm into the cube: a ball that is let through has its middle in it
    s.press.speed = 2 / std::numbers::pi * speed;  // its peak is `speed`
    s.hand.stiffness = 3000;                       // a hand that means it
    s.hand.damping = 20;
    s.deeper = 1e-6;
    Scene scene = bench.scene();
    scene.contact = contact;
    scene.first().device.max_speed = 100;
    return StabilityBench(scene).daemon(1, s);
  };
  const double slow = run(0.05, Renewal::renewed).force;
  const auto trial = [run, slow](double speed, Renewal contact) {
    ClosedLoopResult r = run(speed, contact);
    return trial_of(100 * std::abs(r.force - slow) / slow, std::move(r));
  };
  plan.run_naive = [trial](double speed) { return trial(speed, Renewal::frozen); };
  plan.run_ours = [trial](double speed) { return trial(speed, Renewal::renewed); };
  return plan;
}

// The ball is pressed between the cubes by a hand that turns as well.
StabilityPlan plan_wedge(StabilityBench& bench, bool quick) {
  StabilityPlan plan;
  plan.parameter = "lever arm from the hand to the tip between two cubes [mm]";
  plan.naive = "contact force and torque held for the 20 ms of a simulation step";
  plan.ours = "the daemon";
  plan.judged = "swing at rest beyond two quanta, turning included [µm]";
  plan.limit = swing_limit_um;
  plan.reason = "150 mm: a hand piece held at its end";
  plan.required = 150;
  plan.trace_y = "torque on the hand [mN·m]";
  plan.values = quick ? std::vector<double>{20, 160} : geometric(10, 320, 2);
  const auto run = [&bench](double mm, Rendering rendering) {
    const double arm = 1e-3 * mm;
    Scene scene = two_cubes(bench.scene(), 1);
    SceneInstrument& held = scene.first();
    for (Primitive& p : held.shape.primitives) p.placement.p.z() -= arm;
    // As stiff at the tip as before.
    held.coupling.rotational_stiffness = held.coupling.stiffness * std::max(arm * arm, 1e-4);
    held.device.max_torque = held.device.max_force;
    ClosedLoopSettings s = bench.press();
    s.press.start = Vec3(0.5e-3, 0, top + 6e-3 + arm);
    s.press.depth = 12e-3;
    HandSettings turning = s.hand;
    turning.mass *= grip * grip;
    turning.stiffness *= grip * grip;
    turning.damping *= grip * grip;
    turning.device_damping *= grip * grip;
    turning.quantum = 0.1e-3;
    s.turning = turning;
    DaemonRendererOptions options;
    options.rendering = rendering;
    ClosedLoopResult r = StabilityBench(scene).daemon(1, s, options);
    const double swing = std::max(r.swing - 2 * s.hand.quantum, (r.turning - 2 * turning.quantum) * arm);
    StabilityTrial trial = trial_of(1e6 * swing, std::move(r));
    trial.trace.clear();
    for (const ClosedLoopTick& tick : trial.loop->ticks) trial.trace.emplace_back(tick.t, 1e3 * tick.torque);
    return trial;
  };
  plan.run_naive = [run](double mm) { return run(mm, Rendering::held); };
  plan.run_ours = [run](double mm) { return run(mm, Rendering::solved); };
  return plan;
}

StabilityPlan plan_stiffness_ratio(StabilityBench& bench, bool quick) {
  StabilityPlan plan;
  plan.parameter = "stiffness of one of two cubes over the other's, the tip wedged between them";
  plan.naive = "contact force held for the 20 ms of a simulation step";
  plan.ours = "the daemon";
  plan.judged = "swing at rest beyond two quanta [µm]";
  plan.limit = swing_limit_um;
  plan.reason = "10⁶: gel beside bone (5 kPa, 5 GPa)";
  plan.required = 1e6;
  plan.values = quick ? std::vector<double>{1, 1e6} : geometric(1, 1e6, 10);
  const auto run = [&bench](double ratio, Rendering rendering) {
    ClosedLoopSettings s = bench.press();
    s.press.start = Vec3(0, 0, top + 6e-3);
    s.press.depth = 12e-3;
    DaemonRendererOptions options;
    options.rendering = rendering;
    return by_swing(StabilityBench(two_cubes(bench.scene(), ratio)).daemon(1, s, options), s.hand);
  };
  plan.run_naive = [run](double ratio) { return run(ratio, Rendering::held); };
  plan.run_ours = [run](double ratio) { return run(ratio, Rendering::solved); };
  return plan;
}

}  // namespace hapticd
