#include "tools/stability/bench/stability_bench.h"

#include <cmath>
#include <limits>

namespace hapticd {

namespace {

constexpr double least_scale = 1e-6;  // of forces that no hand feels
constexpr double unlimited = 1e6;      // of the device: [N], [N/s]

}  // namespace

StabilityBench::StabilityBench(const Scene& cube) : scene_(cube) {
  scene_.first().device.max_force = scene_.first().device.max_force_rate = unlimited;
  press_.hand.mass = 0.1;
  press_.hand.stiffness = 300;
  press_.hand.damping = 4;
  press_.hand.device_damping = 0.1;
  press_.hand.quantum = 20e-6;
  press_.press.start = Vec3(0, 0, 26e-3);
  press_.press.depth = 6e-3;
  press_.press.speed = 0.02;
  press_.press.hold = 0.4;
}

ClosedLoopResult StabilityBench::daemon(double force_scale, const ClosedLoopSettings& s,
                                        const DaemonRendererOptions& options, double rate) const {
  Scene scene = scene_;
  scene.first().device.force_scale = force_scale;
  scene.first().device.quantum = s.hand.quantum;
  scene.rate = rate;
  DaemonRenderer daemon(scene, options);
  return run_closed_loop(daemon, s);
}

ClosedLoopResult StabilityBench::held(double force_scale, const ClosedLoopSettings& s,
                                      DaemonRendererOptions options, double rate) const {
  options.rendering = Rendering::held;
  return daemon(force_scale, s, options, rate);
}

double StabilityBench::displayed(double force_scale, const ClosedLoopResult& r) {
  if (slow_.empty()) {
    ClosedLoopSettings s = press_;
    s.press.speed = slow_press;
    s.press.hold = 0.1;
    s.hand.quantum = 0;
    slow_ = daemon(least_scale, s).ticks;
  }
  return force_scale * slope_at(slow_, least_scale, r.force / force_scale);
}

double slope_at(const std::vector<ClosedLoopTick>& slow, double scale, double wanted) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (const ClosedLoopTick& tick : slow) {
    const double force = tick.force / scale;
    if (!(std::abs(force - wanted) < 0.25 * wanted)) continue;
    n += 1;
    sx += tick.depth;
    sy += force;
    sxx += tick.depth * tick.depth;
    sxy += tick.depth * force;
  }
  const double spread = n * sxx - sx * sx;
  return spread > 0 ? (n * sxy - sx * sy) / spread : 0;
}

ClosedLoopResult StabilityBench::wall(double stiffness, const ClosedLoopSettings& s,
                                      double damping_time) const {
  const Press& p = press_.press;
  SpringWall wall(p.start + (p.depth - 2e-3) * p.direction, -p.direction, stiffness, damping_time);
  return run_closed_loop(wall, s);
}

bool swings(const ClosedLoopResult& r, const HandSettings& hand) {
  return !r.finite || r.swing > swing_limit + 2 * hand.quantum;
}

bool makes_energy(const ClosedLoopResult& r) { return !r.finite || r.surplus_min < -made_limit; }

StabilityTrial trial_of(double judged, ClosedLoopResult r) {
  StabilityTrial trial;
  trial.judged = r.finite ? judged : std::numeric_limits<double>::infinity();
  trial.status = r.status;
  for (std::size_t i = 0; i < r.ticks.size(); i += 2)
    trial.trace.emplace_back(r.ticks[i].t, r.ticks[i].force);
  trial.loop = std::move(r);
  return trial;
}

StabilityTrial by_swing(ClosedLoopResult r, const HandSettings& hand) {
  const double beyond = 1e6 * (r.swing - 2 * hand.quantum);
  return trial_of(beyond, std::move(r));
}

StabilityTrial by_energy(ClosedLoopResult r) {
  const double made = -1e6 * r.surplus_min;
  return trial_of(made, std::move(r));
}

std::vector<double> geometric(double from, double to, double factor) {
  std::vector<double> values;
  for (double value = from; value <= to * 1.0001; value *= factor) values.push_back(value);
  return values;
}

}  // namespace hapticd
