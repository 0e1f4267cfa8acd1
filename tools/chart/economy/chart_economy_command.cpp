// haptic chart economy: what chart_economy.h measures, of the shipped economy scenes or of any.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>

#include "server/files/paths.h"
#include "server/os/realtime.h"
#include "server/scene/scene_reader.h"
#include "tools/chart/chart.h"
#include "tools/chart/economy/chart_economy.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

constexpr double most_over_cheapest = 1.2;

struct EconomyOptions {
  std::vector<std::string> scenes;
  bool quick = false;
  std::string json, csv;
  bool force = false;
};

std::vector<std::string> shipped_scenes() {
  std::vector<std::string> scenes;
  for (const char* name : {"static_pad", "stiff_tool", "small_motion", "large_rotation", "everything"})
    scenes.push_back((config_directory() / "scenes" / "economy" / (std::string(name) + ".yaml")).string());
  return scenes;
}

nlohmann::ordered_json to_json(const EconomyModel& m) {
  return {
      {"model", m.label}, {"error", m.error}, {"cost_ms", rounded(m.cost_ms, 4)}, {"inverted", m.inverted}};
}

bool passed(const EconomyScene& e, bool all) {
  return e.within_accuracy() && (!all || e.over_cheapest() <= most_over_cheapest);
}

void print(const EconomyScene& e, bool all) {
  std::printf("%s: accuracy %.3g, %s\n", e.scene.c_str(), e.accuracy, passed(e, all) ? "passed" : "FAILED");
  const auto row = [](const char* what, const EconomyModel& m) {
    std::printf("  %-9s error %8.4f  cost %7.3f ms  %s%s\n", what, m.error, m.cost_ms, m.label.c_str(),
                m.inverted > 0 ? "  (inverted)" : "");
  };
  row("plan", e.chosen);
  std::printf("            estimated %.4f and %.3f ms in %.1f s\n", e.plan.error_estimate, e.plan.cost_ms,
              e.plan.seconds);
  if (all && !e.cheapest.label.empty()) row("cheapest", e.cheapest);
  row("whole", e.whole);
  if (all)
    std::printf("            %zu models; half the reference's step changes it by %.4f\n", e.models.size(),
                e.reference_change);
}

constexpr const char* csv_header = "scene,accuracy,model,error,cost_ms,chosen,cheapest\n";

int chart(EconomyOptions& o) {
  prepare_outputs("economy", csv_header, "", o.json, o.csv, o.force);
  keep_malloc_pages();
  const std::vector<std::string> files = o.scenes.empty() ? shipped_scenes() : o.scenes;
  nlohmann::ordered_json json;
  json["command"] = "chart economy";
  std::ostringstream csv;
  csv << csv_header;
  bool all_passed = true;
  for (std::size_t i = 0; i < files.size(); ++i) {
    const Scene scene = read_scene(files[i]);
    EconomyScene e;
    {
      Progress progress("chart");
      e = measure_economy(scene, !o.quick, [&](double fraction, const std::string& what) {
        progress.show((static_cast<double>(i) + fraction) / static_cast<double>(files.size()), what);
        return !interrupted();
      });
    }
    if (interrupted()) return 1;
    print(e, !o.quick);
    all_passed = all_passed && passed(e, !o.quick);
    nlohmann::ordered_json entry = {{"scene", e.scene},
                                    {"accuracy", e.accuracy},
                                    {"passed", passed(e, !o.quick)},
                                    {"chosen", to_json(e.chosen)},
                                    {"whole", to_json(e.whole)},
                                    {"plan", to_json(e.plan)}};
    if (!o.quick) {
      entry["cheapest"] = to_json(e.cheapest);
      entry["over_cheapest"] = rounded(e.over_cheapest(), 3);
      entry["reference_change"] = e.reference_change;
    }
    for (const EconomyModel& m : e.models) {
      entry["models"].push_back(to_json(m));
      csv << e.scene << ',' << e.accuracy << ",\"" << m.label << "\"," << m.error << ',' << m.cost_ms << ','
          << (m.label == e.chosen.label) << ',' << (m.label == e.cheapest.label) << '\n';
    }
    json["scenes"].push_back(entry);
  }
  if (!o.json.empty()) write_json(o.json, json);
  if (!o.csv.empty()) write_file(o.csv, csv.str());
  return all_passed ? 0 : 1;
}

}  // namespace

Command add_chart_economy(CLI::App& chart_app) {
  auto options = std::make_shared<EconomyOptions>();
  CLI::App* app = chart_app.add_subcommand(
      "economy", "Whether a scene's plan (model: auto) is within its accuracy, and the cheapest that is.");
  app->add_option("SCENE", options->scenes,
                  "scenes with a trajectory; none: the five of config/scenes/economy");
  app->add_flag("--quick", options->quick, "the plan and the whole model alone");
  app->add_option("--json", options->json, "figures to this file");
  app->add_option("--csv", options->csv, "every model measured to this file");
  add_force_option(*app, options->force);
  app->footer(
      "Example: haptic chart economy --json economy.json\n"
      "Exit code 1: a plan misses its accuracy, or costs a fifth more than the cheapest model that does "
      "not.");
  return {app, [options] { return chart(*options); }};
}

}  // namespace hapticd
