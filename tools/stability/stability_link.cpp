#include "tools/stability/stability_link.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double stiff_scale = 16;  // about 500 N/m displayed
constexpr double felt_until = 0.5;  // problems so old, with the tank and in what it is compared with [s]
constexpr double most_made = 1e-6;  // [J]

constexpr LinkTrouble links[] = {{0, 0, 0},          {1e-3, 0, 0},          {5e-3, 0, 0},
                                 {5e-3, 2e-3, 0.05}, {20e-3, 0, 0},         {20e-3, 5e-3, 0.05},
                                 {100e-3, 0, 0},     {100e-3, 10e-3, 0.05}, {200e-3, 0, 0}};

Scene strayed_scene(const Scene& cube) {
  Scene scene = cube;
  scene.first().device.force_scale = stiff_scale;
  scene.first().removal = {};  // it presses
  return scene;
}

}  // namespace

bool chart_link(StabilityBench& bench, const StabilitySettings& settings, StabilityChart& chart,
                const ModeProgress& progress) {
  StabilityMode mode;
  mode.mode = "link";
  mode.plan.parameter = "delay of the link, one way [ms]";
  mode.plan.naive = "problems felt however late, without the tank";
  mode.plan.ours = "the same with the tank";
  mode.plan.judged = "energy made by a hand that strays, about 500 N/m displayed [µJ]";
  mode.plan.limit = 1e6 * most_made;
  mode.plan.reason = "200 ms: another continent";
  mode.plan.required = 200;
  mode.survives = true;
  const Scene scene = strayed_scene(bench.scene());
  RandomSettings random;
  random.ticks = settings.random_ticks > 0 ? settings.random_ticks : settings.quick ? 20'000 : 1'000'000;
  random.seed = settings.random_seed;
  random.problem_old = felt_until;
  ClosedLoopSettings press = bench.press();
  press.let_go = press.guided = true;
  press.press.hold = 1;  // five round trips at 100 ms
  std::vector<LinkTrouble> tried(std::begin(links), std::end(links));
  if (settings.quick) tried = {links[0], links[4], links[6]};
  const std::size_t count = tried.size();
  for (std::size_t k = 0; k < count; ++k) {
    bool on = true;
    const auto part = [&](double from, double share) {
      return [&, from, share](double f) {
        return on = progress((static_cast<double>(k) + from + share * f) / static_cast<double>(count));
      };
    };
    LinkPoint p;
    p.link = random.link.emplace(tried[k]);
    random.passivity_control = true;
    p.tanked = run_random(scene, {cube_hand()}, random, part(0, 0.3));
    if (!on) return false;
    random.passivity_control = false;
    p.bare = run_random(scene, {cube_hand()}, random, part(0.3, 0.3));
    if (!on) return false;
    DaemonRendererOptions options;
    options.link = tried[k];
    options.problem_old = felt_until;
    for (const bool tank : {true, false}) {
      if (settings.quick) break;
      options.passivity_control = tank;
      (tank ? p.displayed : p.displayed_bare) =
          largest_sound([&](double f, const ClosedLoopSettings& at) { return bench.daemon(f, at, options); },
                        press, 0.05, 1e3, std::pow(2, 0.25),
                        [&](double f, const ClosedLoopResult& r) { return bench.displayed(f, r); }, 4);
      if (!part(tank ? 0.8 : 1, 0)(0)) return false;
    }
    const double ms = 1e3 * tried[k].delay;
    if (p.bare.made_by_force > most_made && mode.naive_breaks_at == 0)
      mode.naive_breaks_at = std::max(ms, 1e-3);
    if (p.tanked.made_by_force > most_made && mode.default_breaks_at == 0) {
      mode.default_breaks_at = std::max(ms, 1e-3);
      mode.survives = false;
    }
    mode.survives = mode.survives && p.tanked.faults.empty();
    chart.links.push_back(std::move(p));
  }
  chart.modes.push_back(std::move(mode));
  return true;
}

}  // namespace hapticd
