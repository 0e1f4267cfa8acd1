#include "tools/stability.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>

namespace hapticd {

namespace {

constexpr double haptic_period = 1e-3;  // [s]
constexpr double swing_limit = 20e-6;   // and two quanta: more is felt as a buzz [m]
constexpr double made_limit = 1e-6;     // energy made: a thousandth of a press's [J]
constexpr double outside_work = 1e-5;   // done on a hand that has left: 0.01 N over a millimetre [J]
constexpr double least_scale = 1e-6;    // of forces that no hand feels
constexpr double no_limit = 1e6;        // of the device: [N], [N/s]

// Bits that say that the force is being withdrawn, or replaced by damping.
constexpr std::uint32_t safe_states = status_ramping_down | status_disarmed | status_latched |
                                      status_problem_old | status_problem_lost | status_not_finite;

bool swings(const ClosedLoopResult& r, const HandSettings& hand) {
  return !r.finite || r.swing > swing_limit + 2 * hand.quantum;
}
bool makes_energy(const ClosedLoopResult& r) { return !r.finite || r.surplus_min < -made_limit; }

// The cube, and a hand that presses its ball 3 mm into the middle of its top.
class Bench {
 public:
  explicit Bench(const Scene& scene) : scene_(scene) {
    scene_.device.max_force = scene_.device.max_force_rate = no_limit;
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

  ClosedLoopSettings press() const { return press_; }
  Scene scene() const { return scene_; }

  // force_scale: of the device, so the displayed stiffness.
  ClosedLoopResult daemon(double force_scale, const ClosedLoopSettings& s,
                          const VirtualDaemonOptions& options = {}, double rate = 50) const {
    Scene scene = scene_;
    scene.device.force_scale = force_scale;
    scene.rate = rate;
    VirtualDaemon daemon(scene, options);
    return run_closed_loop(daemon, s);
  }
  ClosedLoopResult held(double force_scale, const ClosedLoopSettings& s, VirtualDaemonOptions options = {},
                        double rate = 50) const {
    options.rendering = Rendering::held;
    return daemon(force_scale, s, options, rate);
  }
  // What a daemon of this force_scale displayed in the second hold [N/m]: the slope of the slow press's force
  // where it is as large, by least squares over what is within a quarter of it.
  double displayed(double force_scale, const ClosedLoopResult& r) {
    if (slow_.empty()) {
      ClosedLoopSettings s = press_;
      s.press.speed = 0.5e-3;
      s.press.hold = 0.1;
      s.hand.quantum = 0;
      slow_ = daemon(least_scale, s).ticks;
    }
    const double wanted = r.force / force_scale;
    double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
    for (const ClosedLoopTick& tick : slow_) {
      const double force = tick.force / least_scale;
      if (!(std::abs(force - wanted) < 0.25 * wanted)) continue;
      n += 1;
      sx += tick.depth;
      sy += force;
      sxx += tick.depth * tick.depth;
      sxy += tick.depth * force;
    }
    const double spread = n * sxx - sx * sx;
    return spread > 0 ? force_scale * (n * sxy - sx * sy) / spread : 0;
  }

  // A wall that the press reaches as deep as it does the cube, with stiffness-proportional damping.
  ClosedLoopResult wall(double stiffness, const ClosedLoopSettings& s, double damping_time = 5e-3) const {
    SpringWall wall(s.press.start + (s.press.depth - 2e-3) * s.press.direction, -s.press.direction, stiffness,
                    damping_time);
    return run_closed_loop(wall, s);
  }

 private:
  Scene scene_;
  ClosedLoopSettings press_;
  std::vector<ClosedLoopTick> slow_;
};

// Runs both methods up the values until each has broken.
class Sweep {
 public:
  using Run = std::function<ClosedLoopResult(double)>;
  using Breaks = std::function<bool(const ClosedLoopResult&)>;

  Sweep(StabilityMode& mode, Breaks breaks) : mode_(mode), breaks_(std::move(breaks)) {}

  // False: stopped.
  bool run(double from, double to, double factor, const Run& naive, const Run& ours,
           const std::function<bool(double)>& progress) {
    mode_.swept_from = from;
    mode_.swept_to = to;
    double reached = 0;
    for (double value = from; value <= to * 1.0001; value *= factor) {
      if (!progress(std::log(value / from) / std::log(to * 1.01 / from))) return false;
      StabilityMode::Point point;
      point.value = value;
      point.has_naive = mode_.naive_breaks_at == 0;
      point.has_ours = mode_.default_breaks_at == 0;
      if (point.has_naive) {
        point.naive = naive(value);
        if (breaks_(point.naive)) mode_.naive_breaks_at = value;
      }
      if (point.has_ours) {
        point.ours = ours(value);
        reached = value;
        mode_.default_status = point.ours.status;
        if (breaks_(point.ours)) mode_.default_breaks_at = value;
      }
      if (!point.has_naive && !point.has_ours) break;
      mode_.points.push_back(std::move(point));
    }
    mode_.ends_safe = mode_.default_breaks_at > 0 && (mode_.default_status & safe_states) != 0;
    // What was not tried was not survived.
    mode_.survives =
        mode_.ends_safe || (reached >= mode_.required &&
                            (mode_.default_breaks_at == 0 || mode_.default_breaks_at > mode_.required));
    return true;
  }

 private:
  StabilityMode& mode_;
  Breaks breaks_;
};

using ModeProgress = std::function<bool(double)>;

// The largest stiffness before the first that breaks; what was really displayed, measured.
struct Largest {
  double swinging = 0, passive = 0;
};
template <class Displayed>
Largest largest(const Sweep::Run& run, const HandSettings& hand, double from, double to, double factor,
                const Displayed& displayed) {
  Largest found;
  bool steady = true, passive = true;
  for (double value = from; value <= to && (steady || passive); value *= factor) {
    const ClosedLoopResult r = run(value);
    steady = steady && !swings(r, hand);
    passive = passive && !makes_energy(r) && !swings(r, hand);
    if (steady) found.swinging = displayed(value, r);
    if (passive) found.passive = displayed(value, r);
  }
  return found;
}

bool stiffness_map(Bench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress) {
  const std::vector<double> dampings =
      quick ? std::vector<double>{0.1} : std::vector<double>{0.02, 0.05, 0.1, 0.2, 0.5, 1, 2};
  const double factor = quick ? std::numbers::sqrt2 : std::pow(2, 0.25);
  StabilityMode mode;
  mode.mode = "stiffness";
  mode.parameter = "largest sound displayed stiffness [N/m], device damping 0.1 N·s/m";
  mode.naive = "contact force held for the 20 ms of a simulation step";
  mode.reason = "four fifths of an ideal 1 kHz wall on the same device";
  for (std::size_t k = 0; k < dampings.size(); ++k) {
    if (!progress(static_cast<double>(k) / static_cast<double>(dampings.size()))) return false;
    ClosedLoopSettings s = bench.press();
    s.hand.device_damping = dampings[k];
    const auto itself = [](double K, const ClosedLoopResult&) { return K; };
    const auto shown = [&](double f, const ClosedLoopResult& r) { return bench.displayed(f, r); };
    // The best that the wall does, by either judgement, with damping of 0 to 5 ms.
    Largest wall;
    for (const double time : {0.0, 1e-3, 2e-3, 5e-3}) {
      const Largest w =
          largest([&](double K) { return bench.wall(K, s, time); }, s.hand, 20, 4e5, factor, itself);
      wall.swinging = std::max(wall.swinging, w.swinging);
      wall.passive = std::max(wall.passive, w.passive);
    }
    const Largest ours =
        largest([&](double f) { return bench.daemon(f, s); }, s.hand, 0.5, 1e4, factor, shown);
    const Largest held = largest([&](double f) { return bench.held(f, s); }, s.hand, 0.5, 1e4, factor, shown);
    chart.map.push_back({dampings[k], wall.swinging, ours.swinging, held.swinging, wall.passive, ours.passive,
                         held.passive, 2 * dampings[k] / haptic_period});
    if (std::abs(dampings[k] - 0.1) > 1e-9) continue;
    mode.naive_breaks_at = held.swinging;
    mode.default_breaks_at = ours.swinging;
    mode.analytic_bound = 2 * dampings[k] / haptic_period;
    mode.required = 0.8 * wall.swinging;
    mode.survives = ours.swinging >= mode.required && ours.swinging >= 10 * held.swinging &&
                    ours.passive >= 0.8 * wall.passive;
  }
  chart.modes.push_back(std::move(mode));
  return true;
}

bool delay(Bench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress) {
  const ClosedLoopSettings press = bench.press();
  const double scale = 4;
  StabilityMode mode;
  mode.mode = "delay";
  mode.parameter = "delay of the force [ms], about 100 N/m displayed";
  mode.naive = "contact force held for the 20 ms of a simulation step";
  mode.reason = "2 ms: the round trip over DDS (0.1 ms) and a millisecond each way of a USB device";
  mode.required = 2;
  const double K = bench.displayed(scale, bench.daemon(scale, press));
  mode.analytic_bound = std::max(0.0, 1e3 * (press.hand.device_damping / K - haptic_period / 2));
  const auto with = [&](double ms) {
    ClosedLoopSettings s = press;
    s.hand.delay = 1e-3 * ms;
    return s;
  };
  const bool on =
      Sweep(mode, [&](const ClosedLoopResult& r) { return swings(r, press.hand); })
          .run(
              0.5, 64, quick ? 2 : std::pow(2, 0.25), [&](double ms) { return bench.held(scale, with(ms)); },
              [&](double ms) { return bench.daemon(scale, with(ms)); }, progress);
  chart.modes.push_back(std::move(mode));
  return on;
}

// The simulation stops while the hand is in the tissue, and the hand leaves.
bool stall(Bench& bench, bool, StabilityChart& chart, const ModeProgress& progress) {
  StabilityMode mode;
  mode.mode = "stall";
  mode.by_energy = true;
  mode.parameter = "simulation stands still for [ms], while the hand leaves";
  mode.naive = "the last contact force, until there is a new one";
  mode.reason = "half a second: a process that is swapped or stopped";
  mode.required = 500;
  const auto run = [&](double ms, Rendering rendering) {
    ClosedLoopSettings s = bench.press();
    const double held = s.arm + s.press.depth / s.press.speed + 0.5 * s.press.hold, stop = held - s.arm;
    const Vec3 back = -10e-3 * s.press.direction;
    s.sway = [=](double t) -> Vec3 { return std::clamp((t - stop) / 0.03, 0.0, 1.0) * back; };
    s.press.hold = 1;
    VirtualDaemonOptions options;
    options.rendering = rendering;
    options.stall_from = held;
    options.stall_for = 1e-3 * ms;
    return bench.daemon(1, s, options);
  };
  // Outside by a millimetre, a renderer may brake, but not push.
  const auto pushes = [](const ClosedLoopResult& r) {
    double work = 0;
    for (std::size_t i = 1; i < r.ticks.size(); ++i) {
      const ClosedLoopTick &a = r.ticks[i - 1], &b = r.ticks[i];
      if (b.t > 0.35 && a.depth < 2e-3) work -= a.force * (b.depth - a.depth);
    }
    return !r.finite || work > outside_work;
  };
  const bool on = Sweep(mode, pushes)
                      .run(
                          15.625, 1000, 2, [&](double ms) { return run(ms, Rendering::held); },
                          [&](double ms) { return run(ms, Rendering::solved); }, progress);
  chart.modes.push_back(std::move(mode));
  return on;
}

// Every 100 ms that many states in a row are lost, while the hand moves to and fro in the tissue.
bool loss(Bench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress) {
  StabilityMode mode;
  mode.mode = "packet loss";
  mode.by_energy = true;
  mode.parameter = "states lost in a row, every 100 ms [ms]";
  mode.naive = "the same solve, the last force held until a state comes: no watchdog";
  mode.reason = "64 ms: a wireless link that loses its channel";
  mode.required = 64;
  const auto run = [&](double ms, bool watchdogs) {
    ClosedLoopSettings s = bench.press();
    s.sway = [](double t) -> Vec3 { return 1.5e-3 * std::sin(2 * std::numbers::pi * 4 * t) * Vec3::UnitZ(); };
    const auto lost = static_cast<std::int64_t>(std::lround(ms));
    s.arrives = [=](std::int64_t i) { return i < 400 || i % 100 >= lost; };
    VirtualDaemonOptions options;
    options.watchdogs = watchdogs;
    return bench.daemon(16, s, options);
  };
  const bool on = Sweep(mode, makes_energy)
                      .run(
                          1, 64, quick ? 4 : 2, [&](double ms) { return run(ms, false); },
                          [&](double ms) { return run(ms, true); }, progress);
  chart.modes.push_back(std::move(mode));
  return on;
}

bool quantum(Bench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress) {
  const double scale = 16;
  ClosedLoopSettings press = bench.press();
  press.hand.friction = 0.02;
  StabilityMode mode;
  mode.mode = "quantum";
  mode.by_energy = true;
  mode.parameter = "encoder quantum [µm], Coulomb friction 0.02 N, about 500 N/m displayed";
  mode.naive = "a spring wall as stiff, its damping from the last two readings";
  mode.reason = "55 µm: the coarsest resolution that makers of desktop devices publish";
  mode.required = 55;
  const double K = bench.displayed(scale, bench.daemon(scale, press));
  mode.analytic_bound = 1e6 * 2 * press.hand.friction / K;
  const auto with = [&](double um) {
    ClosedLoopSettings s = press;
    s.hand.quantum = 1e-6 * um;
    return s;
  };
  bool on = true;
  {
    // Swings of two quanta are the encoder's own; more, or energy, is the loop's.
    Sweep sweep(mode, [](const ClosedLoopResult& r) { return makes_energy(r); });
    on = sweep.run(
        5, 2560, quick ? 4 : std::numbers::sqrt2, [&](double um) { return bench.wall(K, with(um)); },
        [&](double um) { return bench.daemon(scale, with(um)); }, progress);
  }
  chart.modes.push_back(std::move(mode));
  return on;
}

bool slow_simulation(Bench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress) {
  const ClosedLoopSettings press = bench.press();
  const double scale = 4;
  StabilityMode mode;
  mode.mode = "slow simulation";
  mode.parameter = "time of a simulation step [ms], published when it ends, about 100 N/m displayed";
  mode.naive = "its contact force held until the next";
  mode.reason = "100 ms: a mesh five times too large for the machine";
  mode.required = 100;
  VirtualDaemonOptions options;
  options.watchdogs = true;
  const auto at_rate = [&](double ms, Rendering rendering) {
    VirtualDaemonOptions o = options;
    o.rendering = rendering;
    o.publish_after = 1e-3 * ms;
    return bench.daemon(scale, press, o, 1e3 / ms);
  };
  const bool on = Sweep(mode, [&](const ClosedLoopResult& r) { return swings(r, press.hand); })
                      .run(
                          5, 160, quick ? 2 : std::numbers::sqrt2,
                          [&](double ms) { return at_rate(ms, Rendering::held); },
                          [&](double ms) { return at_rate(ms, Rendering::solved); }, progress);
  chart.modes.push_back(std::move(mode));
  return on;
}

// The hand rubs to and fro across the cube.
bool friction(Bench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress) {
  StabilityMode mode;
  mode.mode = "friction";
  mode.by_energy = true;
  mode.parameter = "coefficient of friction, the hand rubs at 4 Hz, about 500 N/m displayed";
  mode.naive = "normal forces solved each millisecond, the friction force of the last step held";
  mode.reason = "2: dry rubber on silicone";
  mode.required = 2;
  const auto run = [&](double mu, Rendering rendering) {
    ClosedLoopSettings s = bench.press();
    s.sway = [](double t) -> Vec3 { return 1e-3 * std::sin(2 * std::numbers::pi * 4 * t) * Vec3::UnitX(); };
    Scene scene = bench.scene();
    scene.bodies.front().friction = mu;
    VirtualDaemonOptions options;
    options.rendering = rendering;
    return Bench(scene).daemon(16, s, options);
  };
  const bool on =
      Sweep(mode, makes_energy)
          .run(
              0.03125, 2, quick ? 4 : 2, [&](double mu) { return run(mu, Rendering::frozen_friction); },
              [&](double mu) { return run(mu, Rendering::solved); }, progress);
  chart.modes.push_back(std::move(mode));
  return on;
}

struct Named {
  const char* name;
  bool (*run)(Bench&, bool quick, StabilityChart&, const ModeProgress&);
};
constexpr Named modes[] = {
    {"stiffness", stiffness_map}, {"delay", delay},     {"stall", stall},
    {"packet loss", loss},        {"quantum", quantum}, {"slow simulation", slow_simulation},
    {"friction", friction}};

}  // namespace

std::vector<std::string> stability_mode_names() {
  std::vector<std::string> names;
  for (const Named& m : modes) names.emplace_back(m.name);
  return names;
}

StabilityChart chart_stability(const Scene& scene, const StabilitySettings& settings,
                               const std::function<bool(double, const std::string&)>& progress) {
  Bench bench(scene);
  StabilityChart chart;
  const auto wanted = [&](const char* name) {
    return settings.only.empty() ||
           std::find(settings.only.begin(), settings.only.end(), name) != settings.only.end();
  };
  const double each = 1.0 / static_cast<double>(std::size(modes));
  double done = 0;
  for (const Named& m : modes) {
    const auto within = [&](double fraction) { return progress(done + each * fraction, m.name); };
    if (wanted(m.name) && !m.run(bench, settings.quick, chart, within)) break;
    done += each;
  }
  return chart;
}

}  // namespace hapticd
