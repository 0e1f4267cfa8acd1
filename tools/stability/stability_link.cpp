#include "tools/stability/stability_link.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double stiff_scale = 16;    // about 500 N/m displayed
constexpr double felt_until = 0.5;    // problems so old, with the tank and in what it is compared with [s]
constexpr double most_made = 1e-6;    // [J]
constexpr double most_by_two = 1e-5;  // … by two hands; a ghost of 1 N does 300 µJ in a millisecond

Scene strayed_scene(const Scene& cube) {
  Scene scene = cube;
  scene.first().device.force_scale = stiff_scale;
  scene.first().removal = {};  // it presses
  return scene;
}

// About a place of the cube that no other hand comes to.
StrayingHand hand_beside(double x) {
  StrayingHand hand = cube_hand();
  hand.begin.tip.x() = x;
  hand.next = [x, next = hand.next](Chance& chance, const StrayPlace& from) {
    StrayPlace place = next(chance, from);
    place.tip.x() = x + place.tip.x() / 3;
    return place;
  };
  return hand;
}

// ghosts: 50 N/m, at most 1 N; the hands are 8 to 20 mm apart.
Scene shared_scene(const Scene& cube, bool ghosts) {
  Scene scene = strayed_scene(cube);
  scene.instruments.push_back(scene.first());
  scene.instruments[1].name = "mentor";
  scene.instruments[1].device.id += 1;
  for (int i = 0; ghosts && i < 2; ++i)
    scene.instruments[static_cast<std::size_t>(i)].device.ghost = {
        .of = 1 - i, .stiffness = 50, .max_force = 1};
  return scene;
}

// Whoever says how long wants all of them.
std::vector<LinkTrouble> links_of(const StabilitySettings& settings) {
  if (settings.quick && settings.random_ticks == 0)
    return {LinkTrouble{}, {.delay = 20e-3}, {.delay = 100e-3}};
  return {std::begin(tried_links), std::end(tried_links)};
}

RandomSettings random_of(const StabilitySettings& settings, std::int64_t quick, std::int64_t usual) {
  RandomSettings random;
  random.ticks = settings.random_ticks > 0 ? settings.random_ticks : settings.quick ? quick : usual;
  random.seed = settings.random_seed;
  random.problem_old = felt_until;
  return random;
}

void judge(double delay, const RandomReport& tanked, const RandomReport& bare, StabilityMode& mode) {
  const double ms = std::max(1e3 * delay, 1e-3), most = 1e-6 * mode.plan.limit;
  if (bare.made_by_force > most && mode.naive_breaks_at == 0) mode.naive_breaks_at = ms;
  if (tanked.made_by_force > most && mode.default_breaks_at == 0) {
    mode.default_breaks_at = ms;
    mode.survives = false;
  }
  mode.survives = mode.survives && tanked.faults.empty();
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
  RandomSettings random = random_of(settings, 20'000, 1'000'000);
  ClosedLoopSettings press = bench.press();
  press.let_go = press.guided = true;
  press.press.hold = 1;  // five round trips at 100 ms
  const std::vector<LinkTrouble> tried = links_of(settings);
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
      (tank ? p.displayed : p.displayed_bare) = largest_sound(
          [&](double f, const ClosedLoopSettings& at) { return bench.daemon(f, at, options); }, press, 0.05,
          1e3, std::pow(2, 0.25), [&](double f, const ClosedLoopResult& r) { return bench.displayed(f, r); },
          {.count = 4});
      if (!part(tank ? 0.8 : 1, 0)(0)) return false;
    }
    judge(tried[k].delay, p.tanked, p.bare, mode);
    chart.links.push_back(std::move(p));
  }
  chart.modes.push_back(std::move(mode));
  return true;
}

bool chart_mentor(StabilityBench& bench, const StabilitySettings& settings, StabilityChart& chart,
                  const ModeProgress& progress) {
  StabilityMode mode;
  mode.mode = "mentor";
  mode.plan.parameter = "delay of the link between two hands, one way [ms]";
  mode.plan.naive = "hands and problems felt however late, without the tanks";
  mode.plan.ours = "the same with a tank at each end";
  mode.plan.judged = "energy made by two hands that stray, of both ends together [µJ]";
  mode.plan.limit = 1e6 * most_by_two;
  mode.plan.reason = "200 ms: another continent";
  mode.plan.required = 200;
  mode.survives = true;
  const std::vector<LinkTrouble> tried = links_of(settings);
  RandomSettings random = random_of(settings, 4'000, 160'000);
  random.at_simulation[0] = true;
  const double parts = 4 * static_cast<double>(tried.size());
  double done = 0;
  for (const LinkTrouble& link : tried)
    for (const bool ghosts : {false, true}) {
      MentorPoint p;
      p.link = random.link.emplace(link);
      p.ghost = ghosts;
      for (const bool tank : {true, false}) {
        bool on = true;
        random.passivity_control = tank;
        (tank ? p.tanked : p.bare) =
            run_random(shared_scene(bench.scene(), ghosts), {hand_beside(-6e-3), hand_beside(6e-3)}, random,
                       [&](double f) { return on = progress((done + f) / parts); });
        if (!on) return false;
        done += 1;
      }
      judge(link.delay, p.tanked, p.bare, mode);
      chart.mentors.push_back(std::move(p));
    }
  chart.modes.push_back(std::move(mode));
  return true;
}

}  // namespace hapticd
