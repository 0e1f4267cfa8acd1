// Modes of the handover from one condensed problem to the next: a contact set that changes, elements that go.
//
// The lens of config/scenes/stroke under its tip of 0.6 mm, pressed 0.3 mm in; speeds are the tip's.
#include <algorithm>
#include <cmath>

#include "haptic/device.h"
#include "server/files/paths.h"
#include "server/scene/scene_reader.h"
#include "tools/stability/stability_plans.h"

namespace hapticd {

namespace {

constexpr double pole = 1.75e-3, tip_radius = 0.6e-3;  // of the lens and the tip, in the scene [m]
constexpr double settled = 0.5;                        // after the press begins, it is at rest [s]

Scene lens() {
  Scene scene = read_scene(config_directory() / "scenes/stroke/stroke.yaml");
  scene.first().device.max_force = scene.first().device.max_force_rate = 1e6;
  scene.first().device.max_speed = 10;
  return scene;
}

// The hand comes down on the pole and stays.
ClosedLoopSettings press_on(const Scene& scene, const StabilityBench& bench) {
  ClosedLoopSettings s = bench.press();
  const double scale = scene.first().device.position_scale;
  s.press.start = Vec3(0, 0, (pole + tip_radius + 0.2e-3 - scene.first().device.origin.z()) / scale);
  s.press.depth = 0.53e-3 / scale;
  s.press.speed = 0.04;
  s.press.hold = 0.8;
  s.deeper = 1e-6;
  return s;
}

double peak_of(const std::vector<ClosedLoopTick>& ticks, double from) {
  double peak = 0;
  for (const ClosedLoopTick& tick : ticks)
    if (tick.t >= from) peak = std::max(peak, tick.size);
  return peak;
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace

// The tip slides to and fro: each problem has other contacts than the last.
StabilityPlan plan_swap(StabilityBench& bench, bool quick) {
  StabilityPlan plan;
  plan.parameter = "speed at which the tip slides over the lens [mm/s]";
  plan.naive = "rows frozen for a simulation step, as in the paper";
  plan.ours = "the daemon";
  plan.judged = "force step in the millisecond of a swap, p95 [% of the peak]";
  plan.limit = 8;
  plan.reason = "20 mm/s: a brisk stroke in an eye; the figure asked for";
  plan.required = 20;
  plan.values = quick ? std::vector<double>{5, 20, 40} : geometric(2.5, 80, 2);
  const auto run = [&bench](double mm_s, Renewal contact) {
    Scene scene = lens();
    scene.contact = contact;
    ClosedLoopSettings s = press_on(scene, bench);
    const double way = 1e-3, rate = 1e-3 * mm_s / way, scale = scene.first().device.position_scale;
    s.sway = [=](double t) -> Vec3 {
      const double since = std::max(0.0, t - settled + 0.2);
      return std::min(1.0, since / 0.2) * way / scale * std::sin(rate * since) * Vec3::UnitX();
    };
    DaemonRenderer daemon(scene, {});
    ClosedLoopResult r = run_closed_loop(daemon, s);
    std::vector<double> steps;
    for (std::size_t i = 1; i < r.ticks.size(); ++i)
      if (r.ticks[i].t > settled && r.ticks[i].problem != r.ticks[i - 1].problem)
        steps.push_back(r.ticks[i].step);
    const double peak = peak_of(r.ticks, settled);
    return trial_of(peak > 0 ? 100 * quantile(std::move(steps), 0.95) / peak : 100, std::move(r));
  };
  plan.run_naive = [run](double mm_s) { return run(mm_s, Renewal::frozen); };
  plan.run_ours = [run](double mm_s) { return run(mm_s, Renewal::renewed); };
  return plan;
}

// The pedal goes down while the tip rests on the lens, until nothing is left under it.
StabilityPlan plan_removal(StabilityBench& bench, bool quick) {
  StabilityPlan plan;
  plan.parameter = "elements taken from under the resting tip, to the last [1/s]";
  plan.naive = "no blend: the force of the new problem at once";
  plan.ours = "the daemon: a blend of 5 ms";
  plan.judged = "largest force step in a millisecond [% of the static force]";
  plan.limit = 8;
  plan.reason = "50 a second, one each step: the shipped scenes have 25 and 30";
  plan.required = 50;
  plan.values = quick ? std::vector<double>{25, 50} : std::vector<double>{12.5, 25, 50, 100, 250, 500};
  const auto run = [&bench](double per_second, double blend) {
    Scene scene = lens();
    scene.first().removal.rate = per_second;
    ClosedLoopSettings s = press_on(scene, bench);
    s.buttons = [](double t) -> std::uint32_t { return t > settled ? pedal_phaco : 0u; };
    DaemonRendererOptions options;
    options.blend_time = blend;
    DaemonRenderer daemon(scene, options);
    ClosedLoopResult r = run_closed_loop(daemon, s);
    double before = 0, largest = 0;
    for (const ClosedLoopTick& tick : r.ticks)
      if (tick.t < settled)
        before = tick.size;
      else
        largest = std::max(largest, tick.step);
    StabilityTrial trial = trial_of(before > 0 ? 100 * largest / before : 100, std::move(r));
    trial.says.clear();
    return trial;
  };
  plan.run_naive = [run](double rate) { return run(rate, 0); };
  plan.run_ours = [run](double rate) { return run(rate, 5e-3); };
  return plan;
}

}  // namespace hapticd
