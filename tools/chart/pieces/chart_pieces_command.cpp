// haptic chart pieces: what keeping pieces of tissue apart costs, and how well it does.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>

#include "server/files/paths.h"
#include "server/os/realtime.h"
#include "server/scene/scene_reader.h"
#include "tools/chart/chart.h"
#include "tools/chart/pieces/pieces_report.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

const std::vector<std::string> part_names = {"scenes", "theory", "solvers", "haptic"};

struct PiecesOptions {
  std::vector<std::string> only;
  std::vector<std::string> scenes = {"fragment/fragment", "fragment/one_way", "quadrants/quadrants"};
  int steps = 20000;
  unsigned seed = 1;
  bool quick = false;
  std::string json, out;
  bool force = false;
};

Scene read_piece_scene(const std::string& name) {
  return read_scene(config_file("scenes/" + name + ".yaml"));
}

bool rubs(const Scene& scene) {
  return std::any_of(scene.contacts.begin(), scene.contacts.end(),
                     [](const auto& c) { return c.friction > 0; });
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
      const StirFigures f = stir(read_piece_scene(name), settings, shown(name));
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

  void solvers() {
    PieceSolverSettings settings;
    settings.seed = options_.seed;
    if (options_.quick) {
      settings.steps = 150;
      settings.problems = 4;
      settings.touches = {10, 30, 100, 200};
      settings.budget_us = 20e3;
    }
    json["solvers"] = nlohmann::ordered_json::array();
    std::vector<PieceSolverPoint> points;
    for (const std::string& name : options_.scenes) {
      const auto problems =
          capture_joint_problems(read_piece_scene(name), settings, shown(name + ", problems"));
      const auto of_scene = compare_solvers(name, problems, settings, shown(name + ", solvers"));
      if (interrupted()) return;
      points.insert(points.end(), of_scene.begin(), of_scene.end());
    }
    print(points);
    for (const PieceSolverPoint& p : points) json["solvers"].push_back(to_json(p));
  }

  void haptic() {
    for (const char* key : {"haptic", "haptic_scenes"}) json[key] = nlohmann::ordered_json::array();
    double worst = 0;
    const auto take = [&](const std::vector<PushPoint>& points) {
      if (interrupted()) return;
      print(points);
      for (const PushPoint& p : points) json["haptic"].push_back(to_json(p));
      const double rms_rel = worst_rms_rel(points);
      json["haptic_scenes"].push_back({{"scene", points.front().scene}, {"rms_rel", rms_rel}});
      worst = std::max(worst, rms_rel);
    };
    for (const double mu : {0.5, 0.0}) take(push_block(mu, {}, shown("block on block")));
    for (const std::string& name : options_.scenes)
      for (const bool friction : {true, false}) {
        Scene scene = read_piece_scene(name);
        if (interrupted() || (!friction && (options_.quick || !rubs(scene)))) continue;
        scene.friction = friction;
        scene.name += friction ? "" : ", frictionless";
        take(push_piece(scene, {}, shown(scene.name)));
      }
    json["haptic_rms_rel"] = worst;
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
  prepare_outputs("pieces", "", options.out, options.json, no_csv, options.force);
  keep_malloc_pages();
  const auto wanted = [&](const char* part) {
    return !interrupted() &&
           (options.only.empty() || std::count(options.only.begin(), options.only.end(), part) > 0);
  };
  PiecesChart chart(options);
  if (wanted("scenes")) chart.scenes();
  if (wanted("theory")) chart.theory();
  if (wanted("solvers")) chart.solvers();
  if (wanted("haptic")) chart.haptic();
  if (interrupted()) return 1;
  if (!options.json.empty()) write_json(options.json, chart.json);
  if (!options.out.empty()) draw("plot_chart_pieces.py", options.json, options.out + "/pieces.png");
  return 0;
}

}  // namespace

Command add_chart_pieces(CLI::App& chart) {
  auto options = std::make_shared<PiecesOptions>();
  CLI::App* app =
      chart.add_subcommand("pieces", "Pieces of tissue that touch: cost, overlap and laws of their contact.");
  app->add_flag("--quick", options->quick, "fewer steps and coarser meshes: two minutes");
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
  app->add_option("--out", options->out, "pieces.json and pieces.png into this directory");
  add_force_option(*app, options->force);
  app->footer("Example: haptic chart pieces --quick --json build/pieces.json");
  return {app, [options, app] { return chart_pieces(*options, *app); }};
}

}  // namespace hapticd
