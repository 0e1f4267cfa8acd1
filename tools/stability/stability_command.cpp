// haptic stability: options, figures and pictures of stability.h.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "server/files/paths.h"
#include "server/files/usage.h"
#include "server/scene/scene_reader.h"
#include "tools/chart/chart.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"
#include "tools/client/client.h"
#include "tools/stability/stability_json.h"

namespace hapticd {

namespace {

struct Options {
  std::string json, out;
  bool force = false;
  bool dds = false;
  StabilitySettings settings;
};

std::string at(double value) {
  return value <= 0     ? "–"
         : value >= 1e5 ? fixed(1e-3 * value, 0) + "k"
                        : fixed(value, value < 1     ? 3
                                       : value < 100 ? 1
                                                     : 0);
}

// What was judged at each value, of a mode that goes on where it breaks.
void print_points(const StabilityMode& m) {
  for (const StabilityMode::Point& p : m.points)
    if (p.has_ours)
      std::printf("  at %-8s %.1e of %.0e  %-6s  worst: %s\n", at(p.value).c_str(), p.ours.judged,
                  m.plan.limit, p.ours.judged <= m.plan.limit ? "holds" : "BREAKS", p.ours.worst_of.c_str());
}

bool print(const RandomReport& r) {
  std::printf(
      "random, hands %d, controller %s: %lld ticks, in contact %lld, both %lld, touching %lld, %d removed, "
      "largest force "
      "%.3f of %.1f N, made %.4f mJ (%.4f an episode; %.4f turning left out), farthest %.2f of %.2f mm, "
      "fastest %.1f of "
      "%.1f mm/s, pieces gained %.2g J of up to %.2g J  %s\n",
      r.hands, r.passivity_control ? "on" : "off", static_cast<long long>(r.ticks),
      static_cast<long long>(r.in_contact), static_cast<long long>(r.both_in_contact),
      static_cast<long long>(r.touching), r.removed, r.force_max, r.device_max, 1e3 * r.made,
      1e3 * r.made_by_episode, 1e3 * r.made_by_force, 1e3 * r.farthest, 1e3 * r.farthest_allowed,
      1e3 * r.fastest, 1e3 * r.fastest_allowed, r.gained, r.energy, r.faults.empty() ? "sound" : "UNSOUND");
  if (r.cut_area > 0)
    std::printf("  a blade cut %.1f mm², %d nodes added, %d episodes out of room, cuts gained %.2g J\n",
                1e6 * r.cut_area, r.nodes_added, r.out_of_room, r.split);
  for (const std::string& f : r.faults) std::printf("  %s\n", f.c_str());
  return r.faults.empty();
}

bool print(const StabilityChart& chart) {
  bool all = true;
  std::printf("%-20s %9s %9s %9s %9s  %-10s %s\n", "mode breaks at", "naive", "default", "bound", "required",
              "", "value of");
  for (const StabilityMode& m : chart.modes) {
    std::printf("%-20s %9s %9s %9s %9s  %-10s %s\n", m.mode.c_str(), at(m.naive_breaks_at).c_str(),
                at(m.default_breaks_at).c_str(), at(m.plan.analytic_bound).c_str(),
                at(m.plan.required).c_str(),
                m.survives ? (m.ends_safe ? "safe state" : "survives") : "BREAKS", m.plan.parameter.c_str());
    if (m.plan.goes_on) print_points(m);
    all = all && m.survives;
  }
  for (const RandomReport& r : chart.random) all = print(r) && all;
  for (const CarveReport& r : chart.carve) {
    std::printf(
        "carve: %lld ticks, %lld strokes, %d removed, largest force %.3f of %.1f N, farthest %.2f of %.2f "
        "mm, fastest %.1f of %.1f mm/s, pieces gained %.2g J of up to %.2g J, free ones in %lld of %lld "
        "steps made %.2g J of up to %.2g J  %s\n",
        static_cast<long long>(r.ticks), static_cast<long long>(r.strokes), r.removed, r.force_max,
        r.device_max, 1e3 * r.farthest, 1e3 * r.farthest_allowed, 1e3 * r.fastest, 1e3 * r.fastest_allowed,
        r.gained, r.energy, static_cast<long long>(r.free_steps), static_cast<long long>(r.steps), r.made,
        r.free_energy, r.faults.empty() ? "sound" : "UNSOUND");
    for (const CarveFault& f : r.faults)
      std::printf("  seed %llu, tick %lld: %s\n", static_cast<unsigned long long>(f.seed),
                  static_cast<long long>(f.tick), f.what.c_str());
    all = all && r.faults.empty();
  }
  for (const TwoHandsPoint& p : chart.two_hands) {
    if (p.moves_away) {
      std::printf(
          "two hands: %-14s hand %d, the other %-7s swings %.1f µm, made %.2f µJ at the tissue's scale\n",
          p.body.c_str(), p.hand, p.other.c_str(), 1e6 * p.swing, 1e6 * p.made);
      continue;
    }
    std::printf(
        "two hands: %-14s hand %d, the other %-7s %8s %8s N/m, of a wall as viscous %.2f %.2f, of "
        "the best %.2f %.2f",
        p.body.c_str(), p.hand, p.other.c_str(), at(p.ours.steady).c_str(), at(p.ours.passive).c_str(),
        p.ours.steady / p.alike.steady, p.ours.passive / p.alike.passive, p.ours.steady / p.wall.steady,
        p.ours.passive / p.wall.passive);
    if (p.free.steady > 0)
      std::printf("; not guided %.2f %.2f", p.free.steady / p.alike.steady, p.free.passive / p.alike.passive);
    std::printf("\n");
  }
  for (const LinkPoint& p : chart.links) {
    std::printf(
        "link of %g ± %g ms, loss %g %%: made %.3f µJ with the tank, %.3f without; sound to %.0f (%.0f) N/m "
        "with, %.0f (%.0f) without\n",
        1e3 * p.link.delay, 1e3 * p.link.jitter, 100 * p.link.loss, 1e6 * p.tanked.made_by_force,
        1e6 * p.bare.made_by_force, p.displayed.passive, p.displayed.steady, p.displayed_bare.passive,
        p.displayed_bare.steady);
    for (const std::string& f : p.tanked.faults) std::printf("  with the tank: %s\n", f.c_str());
    for (const std::string& f : p.bare.faults) std::printf("  without: %s\n", f.c_str());
  }
  for (const MentorPoint& p : chart.mentors) {
    std::printf(
        "mentor's hand over %g ± %g ms, loss %g %%%s: both ends made %.3f µJ with the tanks, %.3f without; "
        "one "
        "hand got %.3f, %.3f\n",
        1e3 * p.link.delay, 1e3 * p.link.jitter, 100 * p.link.loss, p.ghost ? ", ghosts" : "",
        1e6 * p.tanked.made_by_force, 1e6 * p.bare.made_by_force, 1e6 * p.tanked.made_at_hand,
        1e6 * p.bare.made_at_hand);
    for (const std::string& f : p.tanked.faults) std::printf("  with the tanks: %s\n", f.c_str());
    for (const std::string& f : p.bare.faults) std::printf("  without: %s\n", f.c_str());
  }
  for (const RandomReport& r : chart.random_two) all = print(r) && all;
  for (const RandomReport& r : chart.random_cuts) all = print(r) && all;
  return all;
}

int stability(const Options& options) {
  const OutputRule rule(options.force);
  rule.require_figures("--json", options.json);
  const std::string stem = options.settings.shard.stem("stability");
  rule.require_figures_folder("--out", options.out, stem + ".json", stem);
  const Scene scene = read_scene(config_directory() / "scenes/cube/cube.yaml");
  StabilityChart chart;
  {
    Progress progress("stability");
    chart = chart_stability(scene, options.settings, [&](double fraction, const std::string& what) {
      progress.show(fraction, what);
      return !interrupted();
    });
  }
  std::vector<DdsPress> presses;
  if (options.dds && !interrupted()) {
    Progress progress("stability over DDS");
    presses = press_over_dds(options.settings.quick, [&](double fraction) {
      progress.show(fraction, "haptic hand");
      return !interrupted();
    });
  }
  if (interrupted()) return 1;
  const bool all = print(chart);
  for (const DdsPress& p : presses)
    std::printf(
        "over DDS: %8.0f N/m displayed  swing %6.1f µm (offline %6.1f)  made %8.2f µJ (%8.2f)  %s%s\n",
        p.displayed, 1e6 * p.swing, 1e6 * p.offline_swing, 1e6 * p.made, 1e6 * p.offline_made,
        p.status ? status_text(p.status).c_str() : "", p.ran ? "" : "  DID NOT RUN");
  nlohmann::ordered_json json = to_json(chart, options.settings.quick);
  for (const DdsPress& p : presses) json["dds"].push_back(to_json(p));
  if (!options.json.empty()) write_json(options.json, json);
  if (!options.out.empty()) {
    std::filesystem::create_directories(options.out);
    const std::string figures = (std::filesystem::path(options.out) / (stem + ".json")).string();
    write_json(figures, json);
    if (!options.settings.shard.is_whole()) return all ? 0 : 1;
    draw("plot_stability.py", figures, options.out);
    std::printf("%s\n", (std::filesystem::path(options.out) / "stability.html").c_str());
  }
  return all ? 0 : 1;
}

}  // namespace

Command add_stability(CLI::App& application) {
  auto options = std::make_shared<Options>();
  CLI::App* app = application.add_subcommand(
      "stability",
      "Where methods break in a closed loop with a hand, and where the daemon does; needs no daemon.");
  app->add_option("--out", options->out, "figures, pictures and stability.html")->type_name("DIR");
  app->add_option("--json", options->json, "figures to this file")->type_name("FILE");
  add_force_option(*app, options->force);
  add_shard_option(*app, options->settings.shard);
  app->add_option("--mode", options->settings.only, "only these")
      ->delimiter(',')
      ->check(CLI::IsMember(stability_mode_names()));
  app->add_flag("--dds", options->dds, "the stiffness mode over DDS too: starts daemons of its own");
  app->add_flag("--quick", options->settings.quick, "wider steps, one device damping: half a minute");
  app->add_option("--ticks", options->settings.random_ticks,
                  "of random, carve, random two, random cuts and link, default a million; of mentor, 160000")
      ->check(positive);
  app->add_option("--late", options->settings.late_steps,
                  "of random, carve, random two and random cuts: each step takes 8 ms · exp(SPREAD n), n a "
                  "normal random number")
      ->check(CLI::Range(0.0, 3.0))
      ->type_name("SPREAD");
  app->add_option("--seed", options->settings.random_seed,
                  "of the first episode of random (40 000 ticks), carve (100 000) and random cuts (8 000); "
                  "the next has "
                  "the next")
      ->check(positive);
  app->footer(
      "Exit code 1 where the daemon breaks within what is required of it.\n"
      "Example: haptic stability --quick --out build/stability");
  return {app, [options] { return stability(*options); }};
}

}  // namespace hapticd
