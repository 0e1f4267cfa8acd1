// Modes of the device and of what it rubs on: the encoder's quantum, friction.
#include <numbers>

#include "tools/stability/stability_plans.h"

namespace hapticd {

namespace {

constexpr double stiff_scale = 16;  // about 500 N/m displayed
constexpr char energy_made[] = "energy that renderer and device made [µJ]";

}  // namespace

StabilityPlan plan_quantum(StabilityBench& bench, bool quick) {
  ClosedLoopSettings press = bench.press();
  press.hand.friction = 0.02;
  StabilityPlan plan;
  plan.parameter = "encoder quantum [µm], Coulomb friction 0.02 N, about 500 N/m displayed";
  plan.naive = "a spring wall as stiff, its damping from the last two readings";
  plan.ours = "the daemon";
  // Swings of two quanta are the encoder's own; more, or energy, is the loop's.
  plan.judged = energy_made;
  plan.limit = made_limit_uj;
  plan.reason = "55 µm: the coarsest resolution that makers of desktop devices publish";
  plan.required = 55;
  const double K = bench.displayed(stiff_scale, bench.daemon(stiff_scale, press));
  plan.analytic_bound = 1e6 * 2 * press.hand.friction / K;
  plan.values = geometric(5, 2560, quick ? 4 : std::numbers::sqrt2);
  const auto with = [press](double um) {
    ClosedLoopSettings s = press;
    s.hand.quantum = 1e-6 * um;
    return s;
  };
  plan.run_naive = [&bench, with, K](double um) { return by_energy(bench.wall(K, with(um))); };
  plan.run_ours = [&bench, with](double um) { return by_energy(bench.daemon(stiff_scale, with(um))); };
  return plan;
}

// The hand rubs to and fro across the cube.
StabilityPlan plan_friction(StabilityBench& bench, bool quick) {
  StabilityPlan plan;
  plan.parameter = "coefficient of friction, the hand rubs at 4 Hz, about 500 N/m displayed";
  plan.naive = "normal forces solved each millisecond, the friction force of the last step held";
  plan.ours = "the daemon";
  plan.judged = energy_made;
  plan.limit = made_limit_uj;
  plan.reason = "2: dry rubber on silicone";
  plan.required = 2;
  plan.values = geometric(0.03125, 2, quick ? 4 : 2);
  const auto run = [&bench](double mu, Rendering rendering) {
    ClosedLoopSettings s = bench.press();
    s.sway = [](double t) -> Vec3 { return 1e-3 * std::sin(2 * std::numbers::pi * 4 * t) * Vec3::UnitX(); };
    Scene scene = bench.scene();
    scene.bodies.front().friction = mu;
    DaemonRendererOptions options;
    options.rendering = rendering;
    return by_energy(StabilityBench(scene).daemon(stiff_scale, s, options));
  };
  plan.run_naive = [run](double mu) { return run(mu, Rendering::frozen_friction); };
  plan.run_ours = [run](double mu) { return run(mu, Rendering::solved); };
  return plan;
}

}  // namespace hapticd
