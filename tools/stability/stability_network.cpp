// Modes of the network: states that are lost, come unevenly, or in the wrong order, while the hand moves to
// and fro in the tissue.
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "tools/stability/stability_plans.h"

namespace hapticd {

namespace {

constexpr double stiff_scale = 16;         // about 500 N/m displayed
constexpr std::int64_t undisturbed = 400;  // ticks: arming, and on the way to the tissue
constexpr char energy_made[] = "energy that renderer and device made [µJ]";

// Uniform in [0, 1), a function of i alone (splitmix64).
double chance(std::int64_t i) {
  std::uint64_t z = static_cast<std::uint64_t>(i) * 0x9e3779b97f4a7c15ull + 0x9e3779b97f4a7c15ull;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

ClosedLoopSettings to_and_fro(const StabilityBench& bench) {
  ClosedLoopSettings s = bench.press();
  s.sway = [](double t) -> Vec3 { return 1.5e-3 * std::sin(2 * std::numbers::pi * 4 * t) * Vec3::UnitZ(); };
  return s;
}

StabilityPlan by_energy_made(const char* naive) {
  StabilityPlan plan;
  plan.naive = naive;
  plan.ours = "the daemon";
  plan.judged = energy_made;
  plan.limit = made_limit_uj;
  return plan;
}

StabilityTrial lossy(const StabilityBench& bench, const std::function<bool(std::int64_t)>& lost,
                     bool watchdogs) {
  ClosedLoopSettings s = to_and_fro(bench);
  s.underway = [lost](std::int64_t i) { return i >= undisturbed && lost(i) ? -1 : 0; };
  DaemonRendererOptions options;
  options.watchdogs = watchdogs;
  return by_energy(bench.daemon(stiff_scale, s, options));
}

constexpr char no_watchdog[] = "the same solve, the last force held until a state comes: no watchdog";

}  // namespace

// Every 100 ms that many states in a row are lost.
StabilityPlan plan_packet_loss(StabilityBench& bench, bool quick) {
  StabilityPlan plan = by_energy_made(no_watchdog);
  plan.parameter = "states lost in a row, every 100 ms [ms]";
  plan.reason = "64 ms: a wireless link that loses its channel";
  plan.required = 64;
  plan.values = geometric(1, 64, quick ? 4 : 2);
  const auto run = [&bench](double ms, bool watchdogs) {
    const auto burst = static_cast<std::int64_t>(std::lround(ms));
    return lossy(
        bench, [burst](std::int64_t i) { return i % 100 < burst; }, watchdogs);
  };
  plan.run_naive = [run](double ms) { return run(ms, false); };
  plan.run_ours = [run](double ms) { return run(ms, true); };
  return plan;
}

// Each state by itself.
StabilityPlan plan_random_loss(StabilityBench& bench, bool) {
  StabilityPlan plan = by_energy_made(no_watchdog);
  plan.parameter = "states lost at random [%]";
  plan.reason = "10 %: a crowded wireless network; a wire loses none";
  plan.required = 10;
  plan.values = {1, 3, 10, 30, 50, 70, 80, 90, 95, 98};
  const auto run = [&bench](double percent, bool watchdogs) {
    return lossy(
        bench, [percent](std::int64_t i) { return chance(i) < 0.01 * percent; }, watchdogs);
  };
  plan.run_naive = [run](double percent) { return run(percent, false); };
  plan.run_ours = [run](double percent) { return run(percent, true); };
  return plan;
}

// In order, but late by up to so much.
StabilityPlan plan_jitter(StabilityBench& bench, bool quick) {
  StabilityPlan plan =
      by_energy_made("a spring wall as stiff, its damping from the last two states as if a tick apart");
  plan.parameter = "each state late by 0 to … at random, in order [ms]";
  plan.reason = "4 ms: Wi-Fi beside other stations; a wire has 0.1 ms";
  plan.required = 4;
  plan.values = geometric(1, 64, quick ? 4 : std::numbers::sqrt2);
  const auto run = [&bench](double ms, bool naive) {
    ClosedLoopSettings s = to_and_fro(bench);
    const auto last = std::make_shared<std::int64_t>(0);
    s.underway = [=](std::int64_t i) {
      const std::int64_t due = i + static_cast<std::int64_t>(chance(i) * (ms + 1));
      *last = std::max(*last, due);
      return static_cast<int>(*last - i);
    };
    return by_energy(naive ? bench.wall(100, s) : bench.daemon(4, s));
  };
  plan.run_naive = [run](double ms) { return run(ms, true); };
  plan.run_ours = [run](double ms) { return run(ms, false); };
  return plan;
}

StabilityPlan plan_reordering(StabilityBench& bench, bool quick) {
  StabilityPlan plan =
      by_energy_made("the same solve of whatever state came last, without a look at its number");
  plan.parameter = "each state late by 0 to … at random, in any order [ms]";
  plan.reason = "2 ms: neighbours change places; DDS itself hands none over out of order";
  plan.required = 2;
  plan.values = geometric(1, 64, quick ? 4 : 2);
  const auto run = [&bench](double ms, bool naive) {
    ClosedLoopSettings s = to_and_fro(bench);
    s.underway = [ms](std::int64_t i) {
      return i < undisturbed ? 0 : static_cast<int>(chance(i) * (ms + 1));
    };
    s.renumbered = naive;
    DaemonRendererOptions options;
    options.watchdogs = !naive;
    return by_energy(bench.daemon(stiff_scale, s, options));
  };
  plan.run_naive = [run](double ms) { return run(ms, true); };
  plan.run_ours = [run](double ms) { return run(ms, false); };
  return plan;
}

}  // namespace hapticd
