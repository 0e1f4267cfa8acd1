// Modes of time: a force that comes late, a simulation that stands still or is slow.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "tools/stability/stability_plans.h"

namespace hapticd {

namespace {

constexpr double tissue_scale = 4;  // about 100 N/m displayed
constexpr char held_for_a_step[] = "contact force held for the 20 ms of a simulation step";
constexpr char beyond_quanta[] = "swing at rest beyond two quanta [µm]";

}  // namespace

StabilityPlan plan_delay(StabilityBench& bench, bool quick) {
  const ClosedLoopSettings press = bench.press();
  StabilityPlan plan;
  plan.parameter = "delay of the force [ms], about 100 N/m displayed";
  plan.naive = held_for_a_step;
  plan.ours = "the daemon";
  plan.judged = beyond_quanta;
  plan.limit = swing_limit_um;
  plan.reason = "2 ms: the round trip over DDS (0.1 ms) and a millisecond each way of a USB device";
  plan.required = 2;
  const double K = bench.displayed(tissue_scale, bench.daemon(tissue_scale, press));
  plan.analytic_bound = std::max(0.0, 1e3 * (press.hand.device_damping / K - haptic_period / 2));
  plan.values = geometric(0.5, 64, quick ? 2 : std::pow(2, 0.25));
  const auto with = [press](double ms) {
    ClosedLoopSettings s = press;
    s.hand.delay = 1e-3 * ms;
    return s;
  };
  plan.run_naive = [&bench, with](double ms) {
    return by_swing(bench.held(tissue_scale, with(ms)), bench.press().hand);
  };
  plan.run_ours = [&bench, with](double ms) {
    return by_swing(bench.daemon(tissue_scale, with(ms)), bench.press().hand);
  };
  return plan;
}

StabilityPlan plan_stall(StabilityBench& bench, bool) {
  StabilityPlan plan;
  plan.parameter = "simulation stands still for [ms], while the hand leaves";
  plan.naive = "the last contact force, until there is a new one";
  plan.ours = "the daemon";
  plan.judged = "work done on the hand outside [µJ]";
  plan.limit = 10;  // 0.01 N over a millimetre
  plan.reason = "half a second: a process that is swapped or stopped";
  plan.required = 500;
  plan.values = geometric(15.625, 1000, 2);
  const auto run = [&bench](double ms, Rendering rendering) {
    ClosedLoopSettings s = bench.press();
    const double held = s.arm + s.press.depth / s.press.speed + 0.5 * s.press.hold, stop = held - s.arm;
    const Vec3 back = -10e-3 * s.press.direction;
    s.sway = [=](double t) -> Vec3 { return std::clamp((t - stop) / 0.03, 0.0, 1.0) * back; };
    s.press.hold = 1;
    DaemonRendererOptions options;
    options.rendering = rendering;
    options.stall_from = held;
    options.stall_for = 1e-3 * ms;
    ClosedLoopResult r = bench.daemon(1, s, options);
    // Outside by a millimetre, a renderer may brake, but not push.
    double work = 0;
    for (std::size_t i = 1; i < r.ticks.size(); ++i) {
      const ClosedLoopTick &a = r.ticks[i - 1], &b = r.ticks[i];
      if (b.t > 0.35 && a.depth < 2e-3) work -= a.force * (b.depth - a.depth);
    }
    return trial_of(1e6 * work, std::move(r));
  };
  plan.run_naive = [run](double ms) { return run(ms, Rendering::held); };
  plan.run_ours = [run](double ms) { return run(ms, Rendering::solved); };
  return plan;
}

StabilityPlan plan_slow_simulation(StabilityBench& bench, bool quick) {
  StabilityPlan plan;
  plan.parameter = "time of a simulation step [ms], published when it ends, about 100 N/m displayed";
  plan.naive = "its contact force held until the next";
  plan.ours = "the daemon";
  plan.judged = beyond_quanta;
  plan.limit = swing_limit_um;
  plan.reason = "100 ms: a mesh five times too large for the machine";
  plan.required = 100;
  plan.values = geometric(5, 160, quick ? 2 : std::numbers::sqrt2);
  const auto at_rate = [&bench](double ms, Rendering rendering) {
    DaemonRendererOptions options;
    options.rendering = rendering;
    options.publish_after = 1e-3 * ms;
    return by_swing(bench.daemon(tissue_scale, bench.press(), options, 1e3 / ms), bench.press().hand);
  };
  plan.run_naive = [at_rate](double ms) { return at_rate(ms, Rendering::held); };
  plan.run_ours = [at_rate](double ms) { return at_rate(ms, Rendering::solved); };
  return plan;
}

}  // namespace hapticd
