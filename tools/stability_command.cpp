// haptic stability: options, figures and pictures of stability.h.
#include <cstdio>
#include <filesystem>
#include <memory>

#include "server/paths.h"
#include "server/scene_reader.h"
#include "tools/chart.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/progress.h"
#include "tools/report.h"
#include "tools/stability.h"

namespace hapticd {

namespace {

struct Options {
  std::string json, out;
  StabilitySettings settings;
};

nlohmann::ordered_json number_or_null(double value, int decimals) {
  return value > 0 ? nlohmann::ordered_json(rounded(value, decimals)) : nlohmann::ordered_json(nullptr);
}

nlohmann::ordered_json to_json(const ClosedLoopResult& r) {
  return {{"finite", r.finite},
          {"swing_um", rounded(1e6 * r.swing, 3)},
          {"stiffness_n_m", rounded(r.stiffness, 2)},
          {"surplus_uj", rounded(1e6 * r.surplus_min, 4)},
          {"force_max_n", rounded(r.force_max, 5)},
          {"force_step_max_n", rounded(r.force_step_max, 5)}};
}

// Depth and force of every second millisecond: pictures need no more.
nlohmann::ordered_json trace(const ClosedLoopResult& r) {
  nlohmann::ordered_json j = {{"t", nlohmann::ordered_json::array()}, {"depth_mm", {}}, {"force_n", {}}};
  for (std::size_t i = 0; i < r.ticks.size(); i += 2) {
    j["t"].push_back(rounded(r.ticks[i].t, 4));
    j["depth_mm"].push_back(rounded(1e3 * r.ticks[i].depth, 4));
    j["force_n"].push_back(rounded(r.ticks[i].force, 5));
  }
  return j;
}

nlohmann::ordered_json to_json(const StabilityMode& m) {
  nlohmann::ordered_json j = {{"mode", m.mode},
                              {"parameter", m.parameter},
                              {"naive", m.naive},
                              {"judged_by", m.by_energy ? "energy" : "swing"},
                              {"swept", {m.swept_from, m.swept_to}},
                              {"naive_breaks_at", number_or_null(m.naive_breaks_at, 3)},
                              {"default_breaks_at", number_or_null(m.default_breaks_at, 3)},
                              {"analytic_bound", number_or_null(m.analytic_bound, 3)},
                              {"required", rounded(m.required, 3)},
                              {"required_because", m.reason},
                              {"default_status_when_broken", m.default_breaks_at > 0 ? m.default_status : 0},
                              {"ends_in_safe_state", m.ends_safe},
                              {"survives_required_range", m.survives}};
  const StabilityMode::Point *broken = nullptr, *beside = nullptr;
  for (const StabilityMode::Point& p : m.points) {
    nlohmann::ordered_json point = {{"value", rounded(p.value, 4)}};
    if (p.has_naive) point["naive"] = to_json(p.naive);
    if (p.has_ours) point["default"] = to_json(p.ours);
    j["points"].push_back(std::move(point));
    if (p.has_naive && p.has_ours) broken = beside = &p;
  }
  // The last value at which both ran: where the first of them breaks.
  if (broken) {
    j["trace_value"] = rounded(broken->value, 4);
    j["trace"] = {{"naive", trace(broken->naive)}, {"default", trace(beside->ours)}};
  }
  return j;
}

nlohmann::ordered_json to_json(const StabilityChart& chart, bool quick) {
  nlohmann::ordered_json json;
  json["command"] = "stability";
  json["quick"] = quick;
  for (const StiffnessPoint& p : chart.map)
    json["map"].push_back({{"device_damping_ns_m", p.damping},
                           {"wall_n_m", rounded(p.wall, 1)},
                           {"default_n_m", rounded(p.ours, 1)},
                           {"held_n_m", rounded(p.held, 1)},
                           {"wall_passive_n_m", rounded(p.wall_passive, 1)},
                           {"default_passive_n_m", rounded(p.ours_passive, 1)},
                           {"held_passive_n_m", rounded(p.held_passive, 1)},
                           {"colgate_n_m", rounded(p.colgate, 1)}});
  json["modes"] = nlohmann::ordered_json::array();
  for (const StabilityMode& m : chart.modes) json["modes"].push_back(to_json(m));
  return json;
}

std::string at(double value) { return value > 0 ? fixed(value, value < 100 ? 1 : 0) : "–"; }

int stability(const Options& options) {
  const Scene scene = read_scene(config_directory() / "scenes/cube/cube.yaml");
  StabilityChart chart;
  {
    Progress progress("stability");
    chart = chart_stability(scene, options.settings, [&](double fraction, const std::string& what) {
      progress.show(fraction, what);
      return !interrupted();
    });
  }
  if (interrupted()) return 1;
  bool all = true;
  std::printf("%-17s %10s %10s %10s %10s\n", "mode", "naive", "default", "bound", "required");
  for (const StabilityMode& m : chart.modes) {
    std::printf("%-17s %10s %10s %10s %10s  %s\n", m.mode.c_str(), at(m.naive_breaks_at).c_str(),
                at(m.default_breaks_at).c_str(), at(m.analytic_bound).c_str(), at(m.required).c_str(),
                m.survives ? (m.ends_safe ? "safe state" : "survives") : "BREAKS");
    all = all && m.survives;
  }
  const nlohmann::ordered_json json = to_json(chart, options.settings.quick);
  if (!options.json.empty()) write_json(options.json, json);
  if (!options.out.empty()) {
    std::filesystem::create_directories(options.out);
    const std::string figures = (std::filesystem::path(options.out) / "stability.json").string();
    write_json(figures, json);
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
  app->add_option("--mode", options->settings.only, "only these")
      ->delimiter(',')
      ->check(CLI::IsMember(stability_mode_names()));
  app->add_flag("--quick", options->settings.quick, "wider steps, one device damping: ten seconds");
  app->footer(
      "Exit code 1 where the daemon breaks within what is required of it.\n"
      "Example: haptic stability --quick --out build/stability");
  return {app, [options] { return stability(*options); }};
}

}  // namespace hapticd
