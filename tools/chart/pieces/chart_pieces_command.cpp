// haptic chart pieces: what keeping pieces of tissue apart costs, and how well it does.
#include <algorithm>
#include <cstdio>
#include <memory>

#include "server/files/paths.h"
#include "server/os/realtime.h"
#include "server/scene/scene_reader.h"
#include "tools/chart/chart.h"
#include "tools/chart/pieces/piece_check.h"
#include "tools/chart/pieces/stirred_scene.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

const std::vector<std::string> part_names = {"scenes", "theory"};

struct PiecesOptions {
  std::vector<std::string> only;
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

nlohmann::ordered_json to_json(const TissueCheck& c) {
  return {{"name", c.name},       {"expected", c.reference},
          {"found", c.value},     {"rel_error", c.relative_error},
          {"asked", c.tolerance}, {"passed", c.passed}};
}

void print(const TissueFindings& theory) {
  for (const TissueCheck& c : theory.checks)
    std::printf("  %-5s %-92s %12.6g %12.6g  %.1e of %.0e\n", c.passed ? "ok" : "SHORT", c.name.c_str(),
                c.reference, c.value, c.relative_error, c.tolerance);
  for (const std::string& s : theory.skipped) std::printf("  skip  %s\n", s.c_str());
}

// What has been measured is printed at once.
class PiecesChart {
 public:
  explicit PiecesChart(const PiecesOptions& options) : options_(options) { json["command"] = "chart pieces"; }

  void scenes() {
    json["scenes"] = nlohmann::ordered_json::array();
    for (const std::string& name : options_.scenes) {
      StirSettings settings;
      settings.steps = options_.steps;
      settings.seed = options_.seed;
      const Scene scene = read_scene(config_file("scenes/" + name + ".yaml"));
      const StirFigures f = stir(scene, settings, shown(name));
      if (interrupted()) return;
      print(f);
      json["scenes"].push_back(to_json(f));
    }
  }

  void theory() {
    const Effort effort = options_.quick ? Effort::quick : Effort::full;
    TissueFindings findings;
    const auto& groups = piece_check_groups();
    for (std::size_t g = 0; g < groups.size() && !interrupted(); ++g) {
      progress_.show(static_cast<double>(g) / static_cast<double>(groups.size()), groups[g].name);
      groups[g].run(effort, findings);
    }
    print(findings);
    json["theory"] = nlohmann::ordered_json::array();
    for (const TissueCheck& c : findings.checks) json["theory"].push_back(to_json(c));
  }

  nlohmann::ordered_json json;

 private:
  std::function<bool(double)> shown(const std::string& what) {
    return [this, what](double fraction) {
      progress_.show(fraction, what);
      return !interrupted();
    };
  }

  const PiecesOptions& options_;
  Progress progress_{"chart"};
};

int chart_pieces(PiecesOptions& options, const CLI::App& app) {
  if (options.quick && app.count("--steps") == 0) options.steps = 200;
  std::string no_csv;
  prepare_outputs("pieces", "", "", options.json, no_csv, options.force);
  keep_malloc_pages();
  const auto wanted = [&](const char* part) {
    return !interrupted() &&
           (options.only.empty() || std::count(options.only.begin(), options.only.end(), part) > 0);
  };
  PiecesChart chart(options);
  if (wanted("scenes")) chart.scenes();
  if (wanted("theory")) chart.theory();
  if (interrupted()) return 1;
  if (!options.json.empty()) write_json(options.json, chart.json);
  return 0;
}

}  // namespace

Command add_chart_pieces(CLI::App& chart) {
  auto options = std::make_shared<PiecesOptions>();
  CLI::App* app =
      chart.add_subcommand("pieces", "Pieces of tissue that touch: cost, overlap and laws of their contact.");
  app->add_flag("--quick", options->quick, "200 steps a scene: half a minute");
  app->add_option("--only", options->only, "only these parts")
      ->delimiter(',')
      ->check(CLI::IsMember(part_names));
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
