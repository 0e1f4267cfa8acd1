// haptic chart pieces: what keeping pieces of tissue apart costs, and how well it does.
#include <cstdio>
#include <memory>

#include "server/files/paths.h"
#include "server/os/realtime.h"
#include "server/scene/scene_reader.h"
#include "tools/chart/chart.h"
#include "tools/chart/pieces/stirred_scene.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

struct PiecesOptions {
  std::vector<std::string> scenes = {"fragment/fragment", "fragment/both_ways", "quadrants/quadrants"};
  int steps = 20000;
  unsigned seed = 1;
  bool quick = false;
  std::string json;
  bool force = false;
};

nlohmann::ordered_json to_json(const StirFigures& f) {
  const Quantiles ms = quantiles(f.step_ms);
  return {
      {"name", f.name},
      {"steps", f.steps},
      {"step_ms", {{"p50", rounded(ms.p50, 2)}, {"p99", rounded(ms.p99, 2)}, {"max", rounded(ms.max, 2)}}},
      {"joint", f.joint},
      {"capped", f.capped},
      {"geometry_held", f.held},
      {"bounded", f.bounded},
      {"rounds_max", f.rounds},
      {"overlap_um_max", rounded(1e6 * f.overlap, 3)},
      {"tunnelled", f.tunnelled},
      {"touches_max", f.touches},
      {"third_law", f.third_law}};
}

void print(const StirFigures& f) {
  const Quantiles ms = quantiles(f.step_ms);
  std::printf(
      "  %-10s %d steps, %d with contacts of bodies: %d capped, %d with geometry held, %d rounds at most; "
      "step ms p50 %.1f p99 %.1f; %d touches; overlap %.2f um, tunnelled %d; third law %.1e\n",
      f.name.c_str(), f.steps, f.joint, f.capped, f.held, f.rounds, ms.p50, ms.p99, f.touches,
      1e6 * f.overlap, f.tunnelled, f.third_law);
}

int chart_pieces(PiecesOptions& options, const CLI::App& app) {
  if (options.quick && app.count("--steps") == 0) options.steps = 200;
  std::string no_csv;
  prepare_outputs("pieces", "", "", options.json, no_csv, options.force);
  keep_malloc_pages();
  nlohmann::ordered_json json;
  json["command"] = "chart pieces";
  json["scenes"] = nlohmann::ordered_json::array();
  {
    Progress progress("chart");
    for (const std::string& name : options.scenes) {
      StirSettings settings;
      settings.steps = options.steps;
      settings.seed = options.seed;
      const Scene scene = read_scene(config_file("scenes/" + name + ".yaml"));
      const StirFigures f = stir(scene, settings, [&](double fraction) {
        progress.show(fraction, name);
        return !interrupted();
      });
      if (interrupted()) return 1;
      print(f);
      json["scenes"].push_back(to_json(f));
    }
  }
  if (!options.json.empty()) write_json(options.json, json);
  return 0;
}

}  // namespace

Command add_chart_pieces(CLI::App& chart) {
  auto options = std::make_shared<PiecesOptions>();
  CLI::App* app =
      chart.add_subcommand("pieces", "Pieces of tissue that touch: cost, overlap and laws of their contact.");
  app->add_flag("--quick", options->quick, "200 steps a scene: half a minute");
  app->add_option("--scenes", options->scenes, "which are stirred, of config/scenes")
      ->delimiter(',')
      ->capture_default_str();
  app->add_option("--steps", options->steps, "a scene")
      ->check(CLI::Range(10, 10000000))
      ->capture_default_str();
  app->add_option("--seed", options->seed, "of the strokes")->capture_default_str();
  app->add_option("--json", options->json, "figures to this file");
  add_force_option(*app, options->force);
  app->footer("Example: haptic chart pieces --quick --json build/pieces.json");
  return {app, [options, app] { return chart_pieces(*options, *app); }};
}

}  // namespace hapticd
