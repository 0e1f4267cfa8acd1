#include "tools/stability/stability_two_hands.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "tools/stability/bench/two_hand_renderer.h"
#include "tools/stability/stability_plans.h"

namespace hapticd {
namespace {

constexpr double apart = 10e-3, reaches = 5e-3;         // device frame: 3 mm of it above the cube [m]
constexpr double comes_at = 0.02, comes_in = 0.15;      // the other, before the first press begins [s]
constexpr double pushed = 0.75e-3;                      // [m]
constexpr double push_time = 0.075, dies_after = 0.05;  // [s]
// What they leave is gone when swings are looked at, in a hold's second half.
constexpr int pushes_a_hold = 2;
constexpr double least_scale = 1e-6;
constexpr double half_held = 3e-3;  // of a nearly free body: nodes so near to its axis are held [m]
constexpr double tissue_scale = 4;  // about 100 N/m displayed, as of mode `delay`

enum class Other { alone, still, pushes, dies };
constexpr const char* names[] = {"alone", "still", "pushes", "dies"};

struct BodyOfRow {
  const char* name;
  double young;  // over the cube's
  bool nearly_free;
};
constexpr BodyOfRow bodies[] = {{"cube, 5 kPa", 1, false},
                                {"soft, 1 kPa", 0.2, false},
                                {"stiff, 50 kPa", 10, false},
                                {"nearly free", 1, true}};

Scene two_hands_scene(const Scene& cube, const BodyOfRow& of) {
  Scene scene = cube;
  scene.sample_spacing = light_spacing;
  SceneBody& body = scene.bodies.front();
  body.material.young *= of.young;
  if (of.nearly_free)
    std::erase_if(body.fixed_nodes, [&](int n) {
      return body.mesh.nodes[static_cast<std::size_t>(n)].head<2>().norm() > half_held;
    });
  scene.instruments.push_back(scene.first());
  scene.instruments[1].name = "second";
  scene.instruments[1].coupling.stiffness *= 0.5;
  scene.instruments[1].coupling.rotational_stiffness *= 0.5;
  scene.instruments[0].device.origin.x() -= apart / 2;
  scene.instruments[1].device.origin.x() += apart / 2;
  return scene;
}

// One of the two, and what the other does.
struct Hands {
  Scene scene;
  int hand;
  Other other;

  ClosedLoopResult run(double force_scale, const ClosedLoopSettings& s,
                       const std::optional<HandSettings>& grip = {}, double* swing_of_other = nullptr) const {
    Scene with = scene;
    for (SceneInstrument& i : with.instruments) {
      i.device.force_scale = force_scale;
      i.device.quantum = s.hand.quantum;
    }
    const double first = s.arm + s.press.depth / s.press.speed, first_end = first + s.press.hold,
                 second = first_end + s.deeper / s.press.speed, second_end = second + s.press.hold;
    const double half = s.press.hold / 2;
    OtherHand told;
    told.grip = grip;
    if (other == Other::dies) told.silent_from = second + dies_after;
    const bool pushes = other == Other::pushes;
    const double pushing = pushes_a_hold * push_time;
    told.at = [=, start = s.press.start](double t) -> Vec3 {
      const double u = std::clamp((t - comes_at) / comes_in, 0.0, 1.0);
      double depth = u * u * u * (10 - 15 * u + 6 * u * u) * reaches;
      for (const double from : {first, second})
        if (pushes && t > from && t < from + pushing)
          depth += pushed * std::pow(std::sin(std::numbers::pi * (t - from) / push_time), 2);
      return start - depth * Vec3::UnitZ();
    };
    TwoHandRenderer renderer(with, hand, told);
    ClosedLoopSettings both = s;
    if (grip || other == Other::dies)
      both.taken_elsewhere = [&] { return renderer.taken_since(0); };
    else if (pushes)
      both.taken_elsewhere = [&] { return renderer.taken_since(s.arm); };
    ClosedLoopResult r = run_closed_loop(renderer, both);
    if (swing_of_other)
      *swing_of_other = std::max(renderer.swing(first_end - half, first_end),
                                 renderer.swing(second_end - half, second_end));
    return r;
  }

  // Alone: the scene has no other instrument.
  ClosedLoopResult press(double force_scale, const ClosedLoopSettings& s) const {
    if (other != Other::alone) return run(force_scale, s);
    Scene one = scene;
    one.instruments = {scene.instruments[static_cast<std::size_t>(hand)]};
    return StabilityBench(one).daemon(force_scale, s);
  }

  // What a body that moves away is judged by, of all starts at the tissue's own scale.
  void sway(const ClosedLoopSettings& s, const Starts& starts, TwoHandsPoint& p) const {
    for (int k = 0; k < starts.count; ++k) {
      const ClosedLoopResult r = press(tissue_scale, begun_at(s, starts, k));
      const double infinity = std::numeric_limits<double>::infinity();
      p.swing = std::max(p.swing, r.finite ? r.swing - 2 * s.hand.quantum : infinity);
      p.made = std::max(p.made, r.finite ? -r.surplus_min : infinity);
    }
  }

  Largest largest(const ClosedLoopSettings& s, double factor, const Starts& starts) const {
    ClosedLoopSettings slowly = s;
    slowly.press.speed = slow_press;
    slowly.press.hold = 0.1;
    slowly.hand.quantum = 0;
    slowly.let_go = false;
    // The other still, where it is there at all. Where it dies it is there in the first hold and not in the
    // second: sound in both, the hand displayed the stiffer of the two.
    std::vector<std::vector<ClosedLoopTick>> slow;
    for (const Other there : {Other::alone, Other::still})
      if (other == Other::dies || (other == Other::alone) == (there == Other::alone))
        slow.push_back(Hands{scene, hand, there}.press(least_scale, slowly).ticks);
    const auto displayed = [&](double f, const ClosedLoopResult& r) {
      double most = 0;
      for (const auto& ticks : slow) most = std::max(most, f * slope_at(ticks, least_scale, r.force / f));
      return most;
    };
    return largest_sound([&](double f, const ClosedLoopSettings& at) { return press(f, at); }, s, 0.5, 1e4,
                         factor, displayed, starts);
  }
};

// The best wall's, and one's as viscous as the tissue.
void press_walls(const StabilityBench& bench, const ClosedLoopSettings& s, double factor,
                 const Starts& starts, bool quick, Largest& best, Largest& alike) {
  for (const double time : quick
                               ? std::vector<double>{1e-3, tissue_viscosity}
                               : std::vector<double>{0, 0.5e-3, 1e-3, 1.5e-3, tissue_viscosity, 3e-3, 5e-3}) {
    const Largest with =
        largest_sound([&](double K, const ClosedLoopSettings& at) { return bench.wall(K, at, time); }, s, 20,
                      4e5, factor, [](double K, const ClosedLoopResult&) { return K; }, starts);
    best = {std::max(best.steady, with.steady), std::max(best.passive, with.passive)};
    if (time == tissue_viscosity) alike = with;
  }
}

}  // namespace

bool chart_two_hands(StabilityBench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress) {
  ClosedLoopSettings s = bench.press();
  s.let_go = s.guided = true;
  const double factor = std::pow(2, quick ? 0.0625 : 0.03125);
  const Starts starts{quick ? 4 : 16, true};
  struct Row {
    const BodyOfRow* body;
    int hand;
    Other other;
  };
  std::vector<Row> rows;
  for (const BodyOfRow& body : bodies)
    for (int hand = 0; hand < (&body == &bodies[0] && !quick ? 2 : 1); ++hand)
      for (const Other other : {Other::alone, Other::still, Other::pushes, Other::dies})
        if (!quick || (&body == &bodies[0] && other != Other::dies)) rows.push_back({&body, hand, other});

  StabilityMode mode;
  mode.mode = "two hands";
  mode.plan.parameter = "largest sound displayed stiffness [N/m] of a hand, least over what the other does";
  mode.plan.naive = "contact force held for the 20 ms of a simulation step, one hand alone";
  mode.plan.ours = "the daemon, two hands in one body";
  mode.plan.judged = "swing at rest beyond two quanta [µm], and energy made [µJ]";
  mode.plan.reason =
      "four fifths of an ideal 1 kHz wall as viscous as the tissue, on the same device, guided along the "
      "press as a wall guides it, by swing and by energy, in every row; of a body that moves away no swing "
      "and no energy at the tissue's own scale";
  mode.plan.last_sound = true;
  Largest wall, alike;
  press_walls(bench, s, factor, starts, quick, wall, alike);
  mode.plan.required = 0.8 * alike.steady;
  mode.naive_breaks_at =
      largest_sound([&](double f, const ClosedLoopSettings& at) { return bench.held(f, at); }, s, 0.5, 1e4,
                    factor, [&](double f, const ClosedLoopResult& r) { return bench.displayed(f, r); },
                    starts)
          .steady;
  mode.survives = true;
  mode.default_breaks_at = 1e300;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (!progress(static_cast<double>(k) / static_cast<double>(rows.size()))) return false;
    const Row& row = rows[k];
    TwoHandsPoint p;
    p.body = row.body->name;
    p.other = names[static_cast<int>(row.other)];
    p.hand = row.hand + 1;
    p.wall = wall;
    p.alike = alike;
    const Hands hands{two_hands_scene(bench.scene(), *row.body), row.hand, row.other};
    p.moves_away = row.body->nearly_free;
    if (p.moves_away) {
      hands.sway(s, starts, p);
      mode.survives = mode.survives && p.swing <= swing_limit && p.made <= made_limit;
      chart.two_hands.push_back(p);
      continue;
    }
    p.ours = hands.largest(s, factor, starts);
    ClosedLoopSettings free = s;
    free.guided = false;
    if (!quick && row.body == &bodies[0] && row.hand == 0) p.free = hands.largest(free, factor, starts);
    mode.survives =
        mode.survives && p.ours.steady >= 0.8 * alike.steady && p.ours.passive >= 0.8 * alike.passive;
    mode.default_breaks_at = std::min(mode.default_breaks_at, p.ours.steady);
    chart.two_hands.push_back(p);
  }
  chart.modes.push_back(std::move(mode));
  return true;
}

StabilityPlan plan_one_late(StabilityBench& bench, bool quick) {
  const ClosedLoopSettings press = bench.press();
  StabilityPlan plan;
  plan.parameter = "delay of one of two hands' forces [ms], about 100 N/m displayed to each";
  plan.naive = "both hands' forces as late";
  plan.ours = "the daemon, two hands in one cube";
  plan.judged = "larger of both hands' swings at rest, beyond two quanta [µm]";
  plan.limit = swing_limit_um;
  plan.reason = "2 ms: the round trip over DDS (0.1 ms) and a millisecond each way of a USB device";
  plan.required = 2;
  plan.values = geometric(0.5, 64, quick ? 4 : std::numbers::sqrt2);
  const Hands hands{two_hands_scene(bench.scene(), bodies[0]), 0, Other::still};
  const auto late = [press, hands](double ms, bool both) {
    ClosedLoopSettings s = press;
    s.hand.delay = 1e-3 * ms;
    HandSettings other = press.hand;
    other.delay = both ? s.hand.delay : 0;
    double swing_of_other = 0;
    ClosedLoopResult r = hands.run(tissue_scale, s, other, &swing_of_other);
    r.swing = std::max(r.swing, swing_of_other);
    return by_swing(std::move(r), press.hand);
  };
  plan.run_naive = [late](double ms) { return late(ms, true); };
  plan.run_ours = [late](double ms) { return late(ms, false); };
  return plan;
}

}  // namespace hapticd
