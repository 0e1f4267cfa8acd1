#include "tools/stability/stability_stiffness.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace hapticd {

namespace {

Largest best(const Largest& a, const Largest& b) {
  return {std::max(a.steady, b.steady), std::max(a.passive, b.passive)};
}

StiffnessPoint measure(StabilityBench& bench, ClosedLoopSettings s, double factor, bool controller) {
  StiffnessPoint p;
  s.let_go = true;
  p.mass = s.hand.mass;
  p.damping = s.hand.damping;
  p.stiffness = s.hand.stiffness;
  p.device_damping = s.hand.device_damping;
  p.colgate = 2 * s.hand.device_damping / haptic_period;
  using Settings = ClosedLoopSettings;
  const auto itself = [](double K, const ClosedLoopResult&) { return K; };
  const auto shown = [&](double f, const ClosedLoopResult& r) { return bench.displayed(f, r); };
  for (const double time : {0.0, 0.5e-3, 1e-3, 1.5e-3, tissue_viscosity, 3e-3, 5e-3}) {
    const Largest with = largest_sound([&](double K, const Settings& at) { return bench.wall(K, at, time); },
                                       s, 20, 4e5, factor, itself);
    p.wall = best(p.wall, with);
    if (time == tissue_viscosity) p.alike = with;
  }
  const auto daemon = [&](const DaemonRendererOptions& options) {
    return largest_sound([&](double f, const Settings& at) { return bench.daemon(f, at, options); }, s, 0.5,
                         1e4, factor, shown);
  };
  p.ours = daemon({});
  DaemonRendererOptions options;
  options.rendering = Rendering::held;
  p.held = daemon(options);
  options = {};
  options.passivity_control = true;
  if (controller) p.controlled = daemon(options);
  return p;
}

StabilityBench lightly_touched(const StabilityBench& bench) {
  Scene scene = bench.scene();
  scene.sample_spacing = light_spacing;
  return StabilityBench(scene);
}

// Both judgements.
bool enough(const StiffnessPoint& p) {
  return p.ours.steady >= 0.8 * p.wall.steady && p.ours.passive >= 0.8 * p.wall.passive &&
         p.ours.steady >= 10 * p.held.steady && p.ours.passive >= 10 * p.held.passive;
}

// In other hands: a wall may choose its viscosity for each of them, tissue has its own.
bool enough_alike(const StiffnessPoint& p) {
  return p.ours.steady >= 0.8 * p.alike.steady && p.ours.passive >= 0.8 * p.alike.passive &&
         p.ours.steady >= 10 * p.held.steady && p.ours.passive >= 10 * p.held.passive;
}

StabilityMode mode_of(const char* name, const char* parameter, const StiffnessPoint& p) {
  StabilityMode mode;
  mode.mode = name;
  mode.plan.parameter = parameter;
  mode.plan.naive = "contact force held for the 20 ms of a simulation step";
  mode.plan.ours = "the daemon";
  mode.plan.judged = "swing at rest beyond two quanta [µm], and energy made [µJ]";
  mode.plan.reason =
      "four fifths of an ideal 1 kHz wall on the same device, ten times the held force, by swing and by "
      "energy";
  mode.plan.last_sound = true;
  mode.plan.analytic_bound = p.colgate;
  mode.plan.required = 0.8 * p.wall.steady;
  mode.naive_breaks_at = p.held.steady;
  mode.default_breaks_at = p.ours.steady;
  return mode;
}

// A hand on a light device (45 g at the tip, as the maker of the Omni says), by its grasp.
struct Grasp {
  const char* name;
  double mass, damping, stiffness;
  const char* source;
};
constexpr double device_mass = 0.045;
constexpr double own_swing = 9;  // a hand's own swing is gone after so many of its times 2 m/b
// The first three are chosen: of the order that those named report, as far as we know, whose tables were not
// at hand. The last is a measurement as it was published.
constexpr Grasp grasps[] = {
    {"finger tip", 0.006, 5, 500,
     "chosen: some grams, several N·s/m, hundreds of N/m, rising with the finger's force, is the order of "
     "Hajian and Howe 1997; damped beyond the critical (1.4), as Park, Pazin, Friedman, Zatsiorsky and "
     "Latash "
     "2014, Clinical Biomechanics 29, 129, found of most of young adults' digits"},
    {"stylus, loose", 0.03, 1.5, 100,
     "chosen, not cited: a stylus in relaxed fingers, meant to be hard on a renderer for its little damping"},
    {"stylus, firm", 0.1, 6, 700, "chosen, not cited: the same gripped hard"},
    {"whole arm", 0.554, 6.45, 135,
     "cited: van Beek, Bergmann Tiest, Mugge and Kappers 2015, Scientific Reports 5, 18004, figure 3: "
     "the fit to one trial of one subject's hand on a HapticMaster"},
};

}  // namespace

bool chart_stiffness(StabilityBench& cube, bool quick, StabilityChart& chart, const ModeProgress& progress) {
  StabilityBench bench = lightly_touched(cube);
  const std::vector<double> dampings =
      quick ? std::vector<double>{0.1} : std::vector<double>{0.02, 0.05, 0.1, 0.2, 0.5, 1, 2};
  const double factor = std::pow(2, 0.0625);
  StabilityMode mode;
  for (std::size_t k = 0; k < dampings.size(); ++k) {
    if (!progress(static_cast<double>(k) / static_cast<double>(dampings.size()))) return false;
    ClosedLoopSettings s = bench.press();
    s.hand.device_damping = dampings[k];
    const StiffnessPoint p = measure(bench, s, factor, !quick);
    chart.map.push_back(p);
    if (std::abs(dampings[k] - 0.1) > 1e-9) continue;
    mode = mode_of("stiffness", "largest sound displayed stiffness [N/m], device damping 0.1 N·s/m", p);
    mode.survives = enough(p);
  }
  chart.modes.push_back(std::move(mode));
  return true;
}

bool chart_grasps(StabilityBench& cube, bool quick, StabilityChart& chart, const ModeProgress& progress) {
  StabilityBench bench = lightly_touched(cube);
  const double factor = quick ? std::pow(2, 0.25) : std::pow(2, 0.0625);
  bool all = true;
  for (const Grasp& g : grasps) {
    if (quick && g.name != grasps[0].name) break;
    if (!progress(static_cast<double>(chart.grasps.size()) / static_cast<double>(std::size(grasps))))
      return false;
    ClosedLoopSettings s = bench.press();
    s.hand.mass = g.mass + device_mass;
    s.hand.damping = g.damping;
    s.hand.stiffness = g.stiffness;
    s.press.hold = std::max(s.press.hold, own_swing * 2 * s.hand.mass / s.hand.damping);
    StiffnessPoint p = measure(bench, s, factor, !quick);
    p.hand = g.name;
    p.source = g.source;
    all = all && enough_alike(p);
    chart.grasps.push_back(std::move(p));
  }
  StabilityMode mode = mode_of(
      "grasps", "largest sound displayed stiffness [N/m], the first of several hands", chart.grasps.front());
  mode.plan.reason =
      "four fifths of an ideal 1 kHz wall as viscous as the tissue, ten times the held force, by swing and "
      "by "
      "energy, in every hand";
  mode.plan.required = 0.8 * chart.grasps.front().alike.steady;
  mode.survives = all;
  chart.modes.push_back(std::move(mode));
  return true;
}

}  // namespace hapticd
