// haptic chart force: options, figures and pictures of chart_force.h.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <sstream>

#include "server/files/paths.h"
#include "server/files/yaml_keys.h"
#include "server/os/realtime.h"
#include "server/scene/scene_reader.h"
#include "tools/chart/chart.h"
#include "tools/chart/force/chart_force.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

struct Options {
  std::string scene;
  std::vector<std::string> recordings, only;
  std::string table, json, csv, out;
  bool force = false;
  ForceChartSettings settings;
  double window_s = 0, depth_mm = 0.3;
  bool cut = false, gradual = false;
  int hands = 0;  // 0: as many as the scene's instruments
};

bool has_blade(const Scene& scene) {
  return std::any_of(scene.instruments.begin(), scene.instruments.end(),
                     [](const SceneInstrument& i) { return !i.shape.blade.sample.empty(); });
}

nlohmann::ordered_json to_json(const ForceError& e) {
  return {{"force_peak_n", e.peak},
          {"force_rms_rel", e.rms_rel},
          {"force_max_rel", e.max_rel},
          {"torque_rms_rel", e.torque_rms_rel},
          {"swap_jump_p95_rel", e.swap_jump_p95_rel},
          {"swap_step_p95_rel", e.swap_step_p95_rel},
          {"reference_step_p95_rel", e.reference_step_p95_rel},
          {"swap_excess_p95_rel", e.swap_excess_p95_rel},
          {"buzz_rms_n", e.buzz_rms_n},
          {"onset_ms", rounded(e.onset_ms, 3)}};
}

// What only several instruments in one tissue have.
void add_hands(const ForcePoint& p, const Scene& scene, nlohmann::ordered_json& j) {
  for (std::size_t i = 0; i < p.hands.size(); ++i) {
    nlohmann::ordered_json hand = {{"instrument", scene.instruments[i].name}};
    hand.update(to_json(p.hands[i]));
    if (i < p.felt_hands.size()) {
      hand["felt_rms_rel"] = p.felt_hands[i].rms_rel;
      hand["felt_max_rel"] = p.felt_hands[i].max_rel;
      hand["felt_swap_jump_p95_rel"] = p.felt_hands[i].swap_jump_p95_rel;
    }
    j["hands"].push_back(std::move(hand));
  }
  j["tick_us"] = {{"p50", rounded(p.haptic_us_p50, 1)}, {"p99", rounded(p.haptic_us_p99, 1)}};
  j["step_ms"] = {{"p50", rounded(p.simulation_step_ms_p50, 3)},
                  {"p99", rounded(p.simulation_step_ms_p99, 3)}};
  j["reciprocity"] = p.reciprocity;
  j["third_law"] = p.third_law;
  j["dropped_samples"] = p.dropped_samples;
  j["uncovered_nodes"] = p.uncovered_nodes;
}

nlohmann::ordered_json to_json(const ForcePoint& p, const Scene& scene) {
  nlohmann::ordered_json j = {{"label", p.label},
                              {"config", p.config},
                              {"trajectory", p.trajectory},
                              {"removals", p.removals},
                              {"cpu_ms_per_s", rounded(p.cpu_ms_per_s, 2)},
                              {"simulation_ms_per_s", rounded(p.simulation_ms_per_s, 2)},
                              {"haptic_ms_per_s", rounded(p.haptic_ms_per_s, 2)},
                              {"references_ms_per_s", rounded(p.references_ms_per_s, 2)},
                              {"simulation_step_ms_p50", rounded(p.simulation_step_ms_p50, 3)},
                              {"simulation_step_ms_p99", rounded(p.simulation_step_ms_p99, 3)},
                              {"haptic_us_p99", rounded(p.haptic_us_p99, 1)},
                              {"force_peak_n", p.error.peak},
                              {"force_rms_rel", p.error.rms_rel},
                              {"force_rms_rel_to_rms", p.error.rms_rel_to_rms},
                              {"force_max_rel", p.error.max_rel},
                              {"torque_rms_rel", p.error.torque_rms_rel},
                              {"swap_jump_p95_rel", p.error.swap_jump_p95_rel},
                              {"swap_step_p95_rel", p.error.swap_step_p95_rel},
                              {"reference_step_p95_rel", p.error.reference_step_p95_rel},
                              {"swap_excess_p95_rel", p.error.swap_excess_p95_rel},
                              {"buzz_rms_n", p.error.buzz_rms_n},
                              {"onset_ms", rounded(p.error.onset_ms, 3)},
                              {"penetration_um", rounded(p.error.penetration_um, 3)},
                              {"memory_mb", rounded(p.memory_mb, 2)},
                              {"inverted", p.inverted},
                              {"solver_capped", p.capped},
                              {"reference_converged", p.reference_converged},
                              {"pareto", p.pareto},
                              {"front_factor", rounded(p.front_factor, 3)}};
  if (p.removals > 0) {
    j["interim_ms_p50"] = rounded(p.interim_ms_p50, 3);
    j["felt_rms_rel"] = p.felt.rms_rel;
    j["felt_max_rel"] = p.felt.max_rel;
    j["felt_swap_jump_p95_rel"] = p.felt.swap_jump_p95_rel;
  }
  if (p.space_rms_rel >= 0) {
    j["space_rms_rel"] = p.space_rms_rel;
    j["space_and_time_rms_rel"] = p.whole_rms_rel;
  }
  if (has_blade(scene)) j["cut_area_mm2"] = rounded(1e6 * p.cut_area, 4);
  if (scene.instruments.size() > 1) add_hands(p, scene, j);
  return j;
}

nlohmann::ordered_json to_json(ForceChart& chart, const Scene& scene) {
  nlohmann::ordered_json json;
  json["command"] = "chart force";
  json["scene"] = scene.name;
  json["default"] = chart.default_label;
  json["force_scale"] = scene.first().device.force_scale;
  chart.shard.prepare(json, {"runs", "points", "notes"}, {"runs"});
  for (const ForceRun& run : chart.runs)
    json["runs"].push_back({{"trajectory", run.trajectory},
                            {"removals", run.removals},
                            {"elements_removed", run.removed},
                            {"cut_area_mm2", rounded(1e6 * run.cut_area, 4)},
                            {"from_s", run.reference[0].empty() ? 0 : run.reference[0].front().t},
                            {"seconds", rounded(1e-3 * static_cast<double>(run.reference[0].size()), 3)},
                            {"reference_step_ms", 1e3 * run.reference_step},
                            {"half_step_rms_rel", run.half_step_rel},
                            {"felt_half_step_rms_rel", run.felt_half_step_rel},
                            {"inverted", run.inverted},
                            {"reference_cpu_s", rounded(run.reference_cpu_s, 2)},
                            {"reference_converged", run.converged},
                            {"felt_reference_converged", run.felt_converged}});
  json["points"] = nlohmann::ordered_json::array();
  for (const ForcePoint& p : chart.points) json["points"].push_back(to_json(p, scene));
  json["notes"] = chart.notes;
  chart.shard.note(json);
  return json;
}

// Forces over time and spectra of the errors, for the pictures: µN are enough.
nlohmann::ordered_json traces_of(const ForceChart& chart, const Scene& scene) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  const auto components = [](const std::vector<OfflineTick>& ticks) {
    nlohmann::ordered_json f = nlohmann::ordered_json::array();
    for (int c = 0; c < 3; ++c) {
      std::vector<double> values;
      for (const OfflineTick& t : ticks) values.push_back(rounded(t.wrench[c], 8));
      f.push_back(values);
    }
    return f;
  };
  for (std::size_t k = 0; k < chart.runs.size(); ++k) {
    const ForceRun& run = chart.runs[k];
    for (std::size_t h = 0; h < scene.instruments.size(); ++h) {
      const int i = static_cast<int>(h);
      nlohmann::ordered_json j;
      j["run"] = k;
      if (scene.instruments.size() > 1) j["hand"] = scene.instruments[h].name;
      j["trajectory"] = run.trajectory;
      j["removals"] = run.removals;
      j["reference"] = components(run.reference[i]);
      for (const ForceRun::Trace& t : run.traces) {
        const Spectrum s = error_spectrum(t.hands[i], run.reference[i]);
        j["runs"].push_back(
            {{"label", t.label}, {"force", components(t.hands[i])}, {"df", s.df}, {"power", s.power}});
      }
      json.push_back(std::move(j));
    }
  }
  return json;
}

constexpr const char* csv_header =
    "label,trajectory,removals,cpu_ms_per_s,simulation_ms_per_s,haptic_ms_per_s,bases_ms_per_s,haptic_us_p99,"
    "force_rms_rel,force_max_rel,swap_jump_p95_rel,buzz_rms_n,onset_ms,penetration_um,memory_mb,space_rms_"
    "rel,"
    "space_and_time_rms_rel,reference_converged,pareto\n";

std::string to_csv(const ForceChart& chart) {
  std::ostringstream csv;
  csv << csv_header;
  for (const ForcePoint& p : chart.points) {
    csv << '"' << p.label << "\"," << p.trajectory << ',' << p.removals << ',' << p.cpu_ms_per_s << ','
        << p.simulation_ms_per_s << ',' << p.haptic_ms_per_s << ',' << p.references_ms_per_s << ','
        << p.haptic_us_p99 << ',' << p.error.rms_rel << ',' << p.error.max_rel << ','
        << p.error.swap_jump_p95_rel << ',' << p.error.buzz_rms_n << ',' << p.error.onset_ms << ','
        << p.error.penetration_um << ',' << p.memory_mb << ',';
    if (p.space_rms_rel >= 0)
      csv << p.space_rms_rel << ',' << p.whole_rms_rel;
    else
      csv << ',';
    csv << ',' << p.reference_converged << ',' << p.pareto << '\n';
  }
  return csv.str();
}

void print_hands(const ForcePoint& p, const Scene& scene) {
  for (std::size_t i = 0; i < p.hands.size(); ++i) {
    const auto line = [](const std::string& name, const ForceError& e) {
      std::printf("  %-34s %9s %8s %8.4f %8.2f %8.2f %8.2f\n", name.c_str(), "", "", e.peak, 100 * e.rms_rel,
                  100 * e.max_rel, 100 * e.swap_jump_p95_rel);
    };
    line("  " + scene.instruments[i].name, p.hands[i]);
    if (i < p.felt_hands.size())
      line("  " + scene.instruments[i].name + ", gone when published", p.felt_hands[i]);
  }
}

void print_chart(const ForceChart& chart, const Scene& scene) {
  for (const ForceRun& run : chart.runs) {
    if (has_blade(scene))
      std::printf("%s: the reference cuts %.2f mm²\n", run.trajectory.c_str(), 1e6 * run.cut_area);
    std::printf("%s, %d removals per 20 ms: half of %g ms differs by %.2f %%, %d inverted%s\n",
                run.trajectory.c_str(), run.removals, 1e3 * run.reference_step, 100 * run.half_step_rel,
                run.inverted, run.converged ? "" : ": REFERENCE NOT CONVERGED");
    if (run.removals > 0)
      std::printf("  references that lose elements when it is published: half differs by %.2f %%%s\n",
                  100 * run.felt_half_step_rel, run.felt_converged ? "" : ": NOT CONVERGED");
    std::printf("  %-34s %9s %8s %8s %8s %8s %8s %9s %7s\n", "", "CPU ms/s", "p99 µs", "peak N", "RMS %",
                "max %", "jump %", "buzz mN", "front");
    for (const ForcePoint& p : chart.points) {
      if (p.trajectory != run.trajectory || p.removals != run.removals) continue;
      std::printf("  %-34s %9.1f %8.0f %8.4f %8.2f %8.2f %8.2f %9.4f %7.2f%s\n", p.label.c_str(),
                  p.cpu_ms_per_s, p.haptic_us_p99, p.error.peak, 100 * p.error.rms_rel, 100 * p.error.max_rel,
                  100 * p.error.swap_jump_p95_rel, 1e3 * p.error.buzz_rms_n, p.front_factor,
                  p.reference_converged ? "" : "  not converged");
      if (scene.instruments.size() > 1) {
        print_hands(p, scene);
        continue;
      }
      if (p.removals > 0)
        std::printf("  %-34s %9s %8s %8.4f %8.2f %8.2f %8.2f\n", "  elements gone when it is published", "",
                    "", p.felt.peak, 100 * p.felt.rms_rel, 100 * p.felt.max_rel,
                    100 * p.felt.swap_jump_p95_rel);
    }
  }
  for (const ForcePoint& p : chart.points)
    if (scene.instruments.size() > 1 && p.label == chart.default_label)
      std::printf(
          "%s: tick p50 %.0f, p99 %.0f µs; step p50 %.1f, p99 %.1f ms; reciprocity %.1g, third law %.1g\n",
          p.trajectory.c_str(), p.haptic_us_p50, p.haptic_us_p99, p.simulation_step_ms_p50,
          p.simulation_step_ms_p99, p.reciprocity, p.third_law);
  for (const std::string& note : chart.notes) std::printf("note: %s\n", note.c_str());
}

int chart(Options options, const CLI::App& app) {
  if (options.settings.quick && app.count("--window") == 0) options.window_s = options.cut ? 0.5 : 0.17;
  if (options.settings.quick && app.count("--removals") == 0) options.settings.removals = {0};
  if (options.window_s > 0) options.settings.window.length = options.window_s;
  options.settings.window.depth = 1e-3 * options.depth_mm;
  if (options.scene.empty()) {
    const char* name = options.cut ? "incision" : options.hands > 1 ? "two_hands" : "stroke";
    options.scene = (config_directory() / "scenes" / name / (std::string(name) + ".yaml")).string();
  }
  prepare_outputs(options.settings.shard.stem("force"), csv_header, options.out, options.json, options.csv,
                  options.force);
  if (!options.out.empty()) options.settings.cache = std::filesystem::path(options.out) / "references";
  keep_malloc_pages();

  Scene scene = read_scene(options.scene);
  for (SceneInstrument& i : scene.instruments) i.removal.gradual |= options.gradual;
  const bool several = scene.instruments.size() > 1;
  if (options.hands > 0 && static_cast<std::size_t>(options.hands) != scene.instruments.size())
    throw UsageError("--hands " + std::to_string(options.hands) + ": the scene has " +
                     std::to_string(scene.instruments.size()) + " instruments");
  if (options.cut && !has_blade(scene)) throw UsageError("--cut: the scene has no blade");
  if (options.table.empty()) {
    const char* table = options.cut ? "force_cut.yaml" : several ? "force_hands.yaml" : "force.yaml";
    options.table = (config_directory() / "charts" / table).string();
  }
  ForceTable table = read_force_table(options.table);
  if (!options.only.empty()) {
    std::vector<ForceConfiguration> kept;
    for (ForceConfiguration& c : table.configurations)
      if (c.label == table.default_label || std::count(options.only.begin(), options.only.end(), c.label) > 0)
        kept.push_back(std::move(c));
    for (const std::string& label : options.only) {
      const auto is_label = [&](const ForceConfiguration& c) { return c.label == label; };
      if (std::any_of(kept.begin(), kept.end(), is_label) || label == "default") continue;
      std::vector<std::string> labels;
      for (const ForceConfiguration& c : read_force_table(options.table).configurations)
        labels.push_back(c.label);
      const std::string hint = did_you_mean(label, labels);
      throw UsageError("--only " + label + ": no such configuration in " + options.table + " (" +
                       (hint.empty() ? "there are: " + listed(labels) : hint) + ")");
    }
    table.configurations = std::move(kept);
  }
  std::vector<std::filesystem::path> recordings(options.recordings.begin(), options.recordings.end());
  if (!table.windows.empty() && !recordings.empty())
    throw UsageError("--trajectory: the table's windows are of the scene's own trajectories");
  if (several && table.windows.empty())
    throw UsageError(options.table + " has no windows, which several instruments need");
  std::vector<ForceWindow> windows;
  for (ForceWindow& w : table.windows) {
    if (options.window_s > 0) w.to = std::min(w.to, w.from + options.window_s);
    const auto same = [&](const ForceWindow& o) {
      return o.from == w.from && o.to == w.to && o.removals == w.removals;
    };
    if (std::none_of(windows.begin(), windows.end(), same)) windows.push_back(std::move(w));
  }
  table.windows = std::move(windows);
  if (recordings.empty() && table.windows.empty()) {
    if (!scene.first().trajectory)
      throw UsageError("the scene has no trajectory: name one with --trajectory");
    recordings = {*scene.first().trajectory};
  }
  ForceChart result;
  {
    Progress progress("chart");
    result = chart_force(scene, recordings, table, options.settings,
                         [&](double fraction, const std::string& what) {
                           progress.show(fraction, what);
                           return !interrupted();
                         });
  }
  if (interrupted()) return 1;
  print_chart(result, scene);
  if (!options.json.empty()) write_json(options.json, to_json(result, scene));
  if (!options.csv.empty()) write_file(options.csv, to_csv(result));
  if (!options.out.empty() && options.settings.shard.is_whole()) {
    write_json(options.out + "/force_traces.json", traces_of(result, scene));
    draw("plot_chart_force.py", options.json, options.out);
  }
  return 0;
}

}  // namespace

Command add_chart_force(CLI::App& chart_app) {
  auto options = std::make_shared<Options>();
  CLI::App* app = chart_app.add_subcommand(
      "force", "Speed against accuracy of the force, for a scene along recorded motions, offline.");
  app->add_option("scene", options->scene,
                  "scene (default: config/scenes/stroke/stroke.yaml; of several hands: "
                  "two_hands/two_hands.yaml; with --cut: "
                  "incision/incision.yaml)");
  app->add_flag("--cut", options->cut, "a blade that cuts, along windows of its stroke");
  app->add_option("--hands", options->hands, "the scene has so many instruments, and each has its own error")
      ->check(CLI::Range(1, max_instruments));
  app->add_option(
      "--trajectory", options->recordings,
      "CSV recordings; the scene's own is mapped, others are fitted into the tissue (default: the "
      "scene's own)");
  app->add_option(
      "--table", options->table,
      "configurations (default: config/charts/force.yaml; of several hands: force_hands.yaml; with --cut: "
      "force_cut.yaml)");
  app->add_option("--only", options->only, "only the configurations with these labels, and the default");
  app->add_option("--removals", options->settings.removals, "elements removed per 20 ms, a run for each")
      ->delimiter(',')
      ->capture_default_str();
  app->add_flag("--gradual", options->gradual, "they go by degrees, whatever the scene says");
  app->add_option("--window", options->window_s,
                  "seconds of each recording, from first contact; of several hands: of each window")
      ->check(CLI::Range(0.05, 60.0));
  app->add_option("--depth", options->depth_mm, "deepest overlap of a fitted recording [mm]")
      ->check(CLI::Range(0.01, 10.0))
      ->capture_default_str();
  app->add_flag("--quick", options->settings.quick,
                "the table's quick configurations, no removals unless asked for, half a minute");
  app->add_option("--json", options->json, "figures to this file");
  app->add_option("--csv", options->csv, "the points to this file");
  app->add_option("--out", options->out, "figures, pictures and kept references into this directory");
  add_force_option(*app, options->force);
  add_shard_option(*app, options->settings.shard);
  app->footer("Example: haptic chart force config/scenes/stroke/stroke.yaml --out build/chart/force");
  return {app, [options, app] { return chart(*options, *app); }};
}

}  // namespace hapticd
