#include "tools/stability/stability.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <future>
#include <iterator>
#include <thread>
#include <utility>

#include "haptic/device.h"
#include "server/files/paths.h"
#include "server/scene/scene_reader.h"
#include "tools/stability/stability_link.h"
#include "tools/stability/stability_plans.h"
#include "tools/stability/stability_stiffness.h"
#include "tools/stability/stability_two_hands.h"

namespace hapticd {

namespace {

// Bits that say that the force is being withdrawn, or replaced by damping.
constexpr std::uint32_t safe_states = status_ramping_down | status_disarmed | status_latched |
                                      status_problem_old | status_problem_lost | status_not_finite;

// Tries both methods up the values until each has broken, the daemon to the end if the plan goes on; false:
// stopped.
bool sweep(StabilityMode& mode, const ModeProgress& progress) {
  const StabilityPlan& plan = mode.plan;
  const auto breaks = [&](const StabilityTrial& trial) { return !(trial.judged <= plan.limit); };
  double reached = 0;
  for (std::size_t k = 0; k < plan.values.size(); ++k) {
    if (!progress(static_cast<double>(k) / static_cast<double>(plan.values.size()))) return false;
    const double value = plan.values[k];
    StabilityMode::Point point;
    point.value = value;
    point.has_naive = mode.naive_breaks_at == 0;
    point.has_ours = mode.default_breaks_at == 0 || plan.goes_on;
    if (!point.has_naive && !point.has_ours) break;
    if (point.has_naive) {
      point.naive = plan.run_naive(value);
      if (breaks(point.naive)) mode.naive_breaks_at = value;
    }
    if (point.has_ours) {
      point.ours = plan.run_ours(value);
      reached = value;
      if (mode.default_breaks_at == 0) {
        mode.default_status = point.ours.status;
        mode.default_says = point.ours.says;
        if (breaks(point.ours)) mode.default_breaks_at = value;
      }
    }
    mode.points.push_back(std::move(point));
  }
  mode.ends_safe =
      mode.default_breaks_at > 0 && ((mode.default_status & safe_states) != 0 || !mode.default_says.empty());
  // What was not tried was not survived.
  mode.survives = mode.ends_safe ||
                  (reached >= plan.required * (1 - 1e-9) &&
                   (mode.default_breaks_at == 0 || mode.default_breaks_at > plan.required * (1 + 1e-9)));
  return true;
}

using Settings = StabilitySettings;

template <StabilityPlan (*plan)(StabilityBench&, bool)>
bool swept(const char* name, StabilityBench& bench, const Settings& settings, StabilityChart& chart,
           const ModeProgress& progress) {
  StabilityMode mode;
  mode.mode = name;
  mode.plan = plan(bench, settings.quick);
  const bool on = sweep(mode, progress);
  chart.modes.push_back(std::move(mode));
  return on;
}

template <bool (*made)(StabilityBench&, bool, StabilityChart&, const ModeProgress&)>
bool charted(const char*, StabilityBench& bench, const Settings& settings, StabilityChart& chart,
             const ModeProgress& progress) {
  return made(bench, settings.quick, chart, progress);
}

bool strayed(const char*, StabilityBench&, const Settings& settings, StabilityChart& chart,
             const ModeProgress& progress) {
  const Scene cataract = read_scene(config_directory() / "scenes/cataract/cataract.yaml");
  RandomSettings random;
  random.ticks = settings.random_ticks > 0 ? settings.random_ticks : settings.quick ? 5000 : 1'000'000;
  random.seed = settings.random_seed;
  random.late_steps = settings.late_steps;
  random.passivity_control = true;
  bool on = true;
  chart.random.push_back(
      run_random(cataract, lens_hands(1), random, [&](double f) { return on = progress(0.9 * f); }));
  if (!on) return false;
  random.passivity_control = false;  // a tenth of it, for comparison
  random.ticks /= 10;
  chart.random.push_back(
      run_random(cataract, lens_hands(1), random, [&](double f) { return on = progress(0.9 + 0.1 * f); }));
  return on;
}

bool carved(const char*, StabilityBench&, const Settings& settings, StabilityChart& chart,
            const ModeProgress& progress) {
  CarveSettings carve;
  if (settings.quick) carve.ticks = 5000;
  if (settings.random_ticks > 0) carve.ticks = settings.random_ticks;
  carve.seed = settings.random_seed;
  carve.late_steps = settings.late_steps;
  bool on = true;
  chart.carve.push_back(run_carve(read_scene(config_directory() / "scenes/cataract/cataract.yaml"), carve,
                                  [&](double f) { return on = progress(f); }));
  return on;
}

bool strayed_together(const char*, StabilityBench&, const Settings& settings, StabilityChart& chart,
                      const ModeProgress& progress) {
  const Scene scene = read_scene(config_directory() / "scenes/two_hands/two_hands.yaml");
  RandomSettings random;
  random.ticks = settings.random_ticks > 0 ? settings.random_ticks : settings.quick ? 2000 : 1'000'000;
  random.seed = settings.random_seed;
  random.late_steps = settings.late_steps;
  bool on = true;
  for (const int hands : {2, 1}) {
    const double from = hands == 2 ? 0 : 0.7;
    chart.random_two.push_back(run_random(scene, lens_hands(hands), random, [&](double f) {
      return on = progress(from + (hands == 2 ? 0.7 : 0.3) * f);
    }));
    if (!on) return false;
  }
  return true;
}

bool strayed_with_a_blade(const char*, StabilityBench&, const Settings& settings, StabilityChart& chart,
                          const ModeProgress& progress) {
  Scene scene = read_scene(config_directory() / "scenes/incision/incision.yaml");
  scene.first().device.force_scale = 4;  // a cut of the whole edge is felt with 0.16 N
  RandomSettings random;
  random.ticks = settings.random_ticks > 0 ? settings.random_ticks : settings.quick ? 2000 : 1'000'000;
  random.episode = 8'000;
  random.seed = settings.random_seed;
  random.late_steps = settings.late_steps;
  bool on = true;
  chart.random_cuts.push_back(
      run_random(scene, {blade_hand()}, random, [&](double f) { return on = progress(f); }));
  return on;
}

bool linked(const char*, StabilityBench& bench, const Settings& settings, StabilityChart& chart,
            const ModeProgress& progress) {
  return chart_link(bench, settings, chart, progress);
}

bool mentored(const char*, StabilityBench& bench, const Settings& settings, StabilityChart& chart,
              const ModeProgress& progress) {
  return chart_mentor(bench, settings, chart, progress);
}

struct Entry {
  const char* name;
  bool (*run)(const char* name, StabilityBench&, const Settings&, StabilityChart&, const ModeProgress&);
  double effort;  // of the whole, for the progress line
};
constexpr Entry entries[] = {
    {"stiffness", charted<chart_stiffness>, 20},
    {"grasps", charted<chart_grasps>, 15},
    {"delay", swept<plan_delay>, 2},
    {"stall", swept<plan_stall>, 1},
    {"problem swap", swept<plan_swap>, 2},
    {"removal under load", swept<plan_removal>, 2},
    {"near-static removal", swept<plan_near_static>, 1},
    {"conforming contacts", swept<plan_conforming>, 2},
    {"duplicated contacts", swept<plan_duplicated>, 2},
    {"crushed elements", swept<plan_crushing>, 2},
    {"incompressible", swept<plan_incompressible>, 2},
    {"large rotation", swept<plan_rotation>, 1},
    {"slender body under its weight", swept<plan_slender>, 10},
    {"pressed and let go", swept<plan_let_go>, 10},
    {"remnant on few nodes", swept<plan_remnant>, 30},
    {"blade below its limit", swept<plan_blade_below>, 2},
    {"blade at its limit", swept<plan_blade_at>, 2},
    {"cut to the last bridge", swept<plan_bridge>, 20},
    {"vacuum", swept<plan_vacuum>, 60},
    {"cracking", swept<plan_cracking>, 20},
    {"last bridge", swept<plan_last_bridge>, 20},
    {"wedged piece", swept<plan_wedged_piece>, 10},
    {"fast stroke", swept<plan_fast_stroke>, 1},
    {"packet loss", swept<plan_packet_loss>, 1},
    {"random loss", swept<plan_random_loss>, 1},
    {"jitter", swept<plan_jitter>, 1},
    {"reordering", swept<plan_reordering>, 1},
    {"quantum", swept<plan_quantum>, 1},
    {"slow simulation", swept<plan_slow_simulation>, 1},
    {"wedged tool", swept<plan_wedge>, 1},
    {"friction", swept<plan_friction>, 1},
    {"stiffness ratio", swept<plan_stiffness_ratio>, 1},
    {"two hands", charted<chart_two_hands>, 60},
    {"one hand late", swept<plan_one_late>, 3},
    {"link", linked, 60},
    {"mentor", mentored, 120},
    {"random", strayed, 50},
    {"carve", carved, 50},
    {"random two", strayed_together, 100},
    {"random cuts", strayed_with_a_blade, 100},
};

}  // namespace

std::vector<std::string> stability_mode_names() {
  std::vector<std::string> names;
  for (const Entry& e : entries) names.emplace_back(e.name);
  return names;
}

StabilityChart chart_stability(const Scene& cube, const StabilitySettings& settings,
                               const std::function<bool(double, const std::string&)>& progress) {
  std::vector<const Entry*> wanted;
  std::vector<std::size_t> unit;  // of the whole run, of each
  std::size_t units = 0;
  double whole = 0;
  for (const Entry& e : entries) {
    if (!settings.only.empty() &&
        std::find(settings.only.begin(), settings.only.end(), e.name) == settings.only.end())
      continue;
    if (!settings.shard.has(units++)) continue;
    unit.push_back(units - 1);
    wanted.push_back(&e);
    whole += e.effort;
  }
  std::vector<StabilityChart> parts(wanted.size());
  std::vector<std::atomic<double>> done(wanted.size());
  std::atomic<std::size_t> next{0};
  std::atomic<bool> on{true};
  // Modes know nothing of one another: a thread for each core, charts joined in the table's order.
  const auto work = [&] {
    StabilityBench bench(cube);
    for (std::size_t k; on && (k = next++) < wanted.size();) {
      const auto within = [&](double fraction) {
        done[k] = fraction;
        return on.load();
      };
      try {
        wanted[k]->run(wanted[k]->name, bench, settings, parts[k], within);
      } catch (...) {
        on = false;
        throw;
      }
      done[k] = 1;
    }
  };
  std::vector<std::future<void>> threads;
  const std::size_t cores = std::max(1u, std::thread::hardware_concurrency());
  for (std::size_t k = 0; k < std::min(cores, wanted.size()); ++k)
    threads.push_back(std::async(std::launch::async, work));
  for (std::future<void>& thread : threads)
    while (thread.wait_for(std::chrono::milliseconds(20)) != std::future_status::ready) {
      double sum = 0;
      for (std::size_t k = 0; k < wanted.size(); ++k) sum += wanted[k]->effort * done[k];
      const std::size_t newest = std::min<std::size_t>(next, wanted.size());
      if (!progress(sum / whole, newest > 0 ? wanted[newest - 1]->name : "")) on = false;
    }
  for (std::future<void>& thread : threads) thread.get();
  StabilityChart chart;
  chart.shard = ShardLedger(settings.shard);
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const auto join = [&](const char* name, auto& all, auto& part) {
      std::move(part.begin(), part.end(), std::back_inserter(all));
      chart.shard.made(name, all.size(), unit[k]);
    };
    StabilityChart& part = parts[k];
    join("map", chart.map, part.map);
    join("grasps", chart.grasps, part.grasps);
    join("modes", chart.modes, part.modes);
    join("random", chart.random, part.random);
    join("carve", chart.carve, part.carve);
    join("two_hands", chart.two_hands, part.two_hands);
    join("random_two", chart.random_two, part.random_two);
    join("random_cuts", chart.random_cuts, part.random_cuts);
    join("links", chart.links, part.links);
    join("mentors", chart.mentors, part.mentors);
  }
  return chart;
}

}  // namespace hapticd
