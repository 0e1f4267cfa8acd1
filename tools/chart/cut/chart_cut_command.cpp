// haptic chart cut: what cuts cost, and whether the force of cutting is what fracture mechanics says.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>

#include "server/os/realtime.h"
#include "tools/chart/chart.h"
#include "tools/chart/cut/blade_draw.h"
#include "tools/chart/cut/cut_cost.h"
#include "tools/chart/cut/tearing_beam.h"
#include "tools/chart/step/chart_step.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

struct CutOptions {
  int count = 2000;
  std::string lens = "5k";
  bool quick = false;
  std::vector<std::string> only;
  std::string json, csv, out;
  bool force = false;
};

nlohmann::ordered_json to_json(const CutCost& c) {
  return {{"count", c.count},
          {"updates", c.updates},
          {"update_us_median", rounded(c.update_us_median, 2)},
          {"update_us_p99", rounded(c.update_us_p99, 2)},
          {"update_us_max", rounded(c.update_us_max, 2)},
          {"flatness", rounded(c.flatness, 3)}};
}

constexpr double cut_depth = 1e-3;  // of the steps' blade [m]

// Steps of the lens while a blade cuts it.
std::vector<StepCase> cutting_steps(const CutOptions& options) {
  std::vector<StepCase> cases;
  for (const StepLens& lens : step_lenses()) {
    if (lens.name != "1k" && (lens.name != "5k" || options.quick)) continue;
    StepCase of;
    of.lens = lens;
    of.method = ComplianceMethod::zone;
    of.cut_depth = cut_depth;
    of.steps = options.quick ? 100 : 600;
    cases.push_back(of);
  }
  return cases;
}

nlohmann::ordered_json to_json(const CutCostFigures& f, const std::vector<StepPoint>& steps,
                               const std::vector<BladeDraw>& draws, const std::vector<TearingBeam>& beams) {
  nlohmann::ordered_json json;
  json["command"] = "chart cut";
  if (f.nodes > 0) {  // else it was not asked for
    json["nodes"] = f.nodes;
    json["tets"] = f.tets;
    json["nodes_after"] = f.nodes_after;
    json["tets_after"] = f.tets_after;
    json["references"] = f.references;
    json["openings"] = to_json(f.openings);
    json["subdivisions"] = to_json(f.subdivisions);
    json["c_rel_error"] = f.c_rel_error;
    json["volume_rel_error"] = {{"opening", f.openings.volume_rel_error},
                                {"subdivision", f.subdivisions.volume_rel_error}};
    json["quality_before"] = rounded(f.quality_before, 4);
    json["quality_min"] = rounded(f.quality_min, 4);
    json["inverted"] = f.inverted;
    json["mesh"] = f.invalid.empty() ? "valid" : f.invalid;
  }
  json["steps"] = nlohmann::ordered_json::array();
  for (const StepPoint& p : steps) {
    const nlohmann::ordered_json ms = {{"p50", rounded(p.step_ms_median, 2)},
                                       {"p99", rounded(p.step_ms_p99, 2)},
                                       {"max", rounded(p.step_ms_max, 2)}};
    json["steps"].push_back({{"nodes", p.nodes},
                             {"compliance", p.compliance},
                             {"steps_that_cut", p.split_steps},
                             {"nodes_added", p.nodes_added},
                             {"references", p.bases},
                             {"late_references", p.late_references},
                             {"step_ms", ms}});
    json["step_ms"] = ms;  // of the largest
  }
  json["draw"] = nlohmann::ordered_json::array();
  for (const BladeDraw& d : draws)
    json["draw"].push_back({{"h_ms", d.h_ms},
                            {"mesh", d.mesh},
                            {"force_n", d.force_n},
                            {"force_deviation_n", d.force_deviation_n},
                            {"expected_n", d.expected_n},
                            {"work_j", d.work_j},
                            {"area_m2", d.area_m2},
                            {"released_j", d.released_j},
                            {"elastic_j", d.elastic_j},
                            {"steps", d.steps},
                            {"split_steps", d.split_steps},
                            {"nodes_added", d.nodes_added},
                            {"step_ms_p99", rounded(d.step_ms_p99, 2)}});
  json["beam"] = nlohmann::ordered_json::array();
  for (const TearingBeam& b : beams)
    json["beam"].push_back({{"nodes", b.nodes},
                            {"elements_across_arm", b.across_arm},
                            {"load_n", b.load_n},
                            {"theory_n", b.theory_n},
                            {"faces", b.torn}});
  return json;
}

void print(const char* what, const CutCost& c) {
  std::printf("  %-13s %5d  update µs p50 %7.1f  p99 %7.1f  max %8.1f  last tenth/first %.2f  volume %.1e\n",
              what, c.count, c.update_us_median, c.update_us_p99, c.update_us_max, c.flatness,
              c.volume_rel_error);
}

int chart_cut(CutOptions& options, const CLI::App& app) {
  if (options.quick) {
    if (app.count("--count") == 0) options.count = 200;
    if (app.count("--lens") == 0) options.lens = "1k";
  }
  prepare_outputs("cut", "", options.out, options.json, options.csv, options.force);
  keep_malloc_pages();
  const auto asked = [&](const std::string& part) {
    return options.only.empty() || std::count(options.only.begin(), options.only.end(), part) > 0;
  };
  CutCostFigures cost;
  std::vector<StepPoint> cutting;
  std::vector<BladeDraw> draws;
  std::vector<TearingBeam> beams;
  {
    Progress progress("chart");
    if (asked("steps"))
      for (const StepCase& of : cutting_steps(options))
        cutting.push_back(chart_step(of, [&](double) {
          progress.show(0.05 * static_cast<double>(cutting.size()),
                        "steps that cut the " + of.lens.name + " lens");
          return !interrupted();
        }));
    if (asked("cost"))
      cost = chart_cut_cost(read_lens(options.lens, {4 * options.count, 3 * options.count}), options.count,
                            0.02, [&](double fraction) {
                              progress.show(0.1 + 0.3 * fraction, "cuts of the " + options.lens + " lens");
                              return !interrupted();
                            });
    const std::vector<double> steps =
        options.quick ? std::vector<double>{0.02} : std::vector<double>{0.005, 0.01, 0.02, 0.04};
    std::vector<int> meshes;
    if (asked("draw")) meshes = options.quick ? std::vector<int>{6} : std::vector<int>{6, 9};
    for (const int cells : meshes)
      for (const double h : steps) {
        if (interrupted()) return 1;
        progress.show(
            0.4 + 0.5 * static_cast<double>(draws.size()) / static_cast<double>(steps.size() * meshes.size()),
            "a blade drawn through a block");
        draws.push_back(draw_blade(h, cells));
      }
    if (asked("beam")) {
      progress.show(0.9, "a beam that tears");
      beams = chart_tearing_beam(options.quick ? std::vector<int>{2, 4} : std::vector<int>{2, 4, 6, 8});
    }
  }
  if (asked("cost")) {
    std::printf("  lens of %d nodes, %d tetrahedra → %d, %d; %d reference factors\n", cost.nodes, cost.tets,
                cost.nodes_after, cost.tets_after, cost.references);
    print("openings", cost.openings);
    print("subdivisions", cost.subdivisions);
    std::printf("  C_pp %.1e off; least quality of what cuts made %.3f (before %.3f); inverted %d; mesh %s\n",
                cost.c_rel_error, cost.quality_min, cost.quality_before, cost.inverted,
                cost.invalid.empty() ? "valid" : cost.invalid.c_str());
  }
  for (const StepPoint& p : cutting) {
    std::printf("  %d nodes, %s, cut at 10 mm/s: step p50 %.2f, p99 %.2f, max %.2f ms in %d steps that cut; ",
                p.nodes, p.compliance.c_str(), p.step_ms_median, p.step_ms_p99, p.step_ms_max, p.split_steps);
    for (std::size_t k = 0; k < step_parts; ++k)
      std::printf("%s %.2f%s", name_of(static_cast<StepPart>(k)), p.parts_ms[k],
                  k + 1 < step_parts ? ", " : "\n");
  }
  for (const BladeDraw& d : draws)
    std::printf(
        "  blade, h %4.0f ms, %d cells: force %.3f ± %.3f mN of %.3f; work %.4f mJ, J·area %.4f, elastic "
        "%+.4f\n",
        d.h_ms, d.mesh, 1e3 * d.force_n, 1e3 * d.force_deviation_n, 1e3 * d.expected_n, 1e3 * d.work_j,
        1e3 * d.released_j, 1e3 * d.elastic_j);
  for (const TearingBeam& b : beams)
    std::printf("  beam, %5d nodes: tears at %.4f mN, theory %.4f (%+.1f %%)\n", b.nodes, 1e3 * b.load_n,
                1e3 * b.theory_n, 100 * (b.load_n / b.theory_n - 1));
  if (!options.json.empty()) write_json(options.json, to_json(cost, cutting, draws, beams));
  return 0;
}

}  // namespace

Command add_chart_cut(CLI::App& chart) {
  auto options = std::make_shared<CutOptions>();
  CLI::App* app = chart.add_subcommand(
      "cut", "What opening and subdividing cost, and the force of cutting and tearing against theory.");
  app->add_flag("--quick", options->quick, "the smallest lens, 200 cuts, one blade: a minute");
  app->add_option("--only", options->only, "only these parts")
      ->delimiter(',')
      ->check(CLI::IsMember({"steps", "cost", "draw", "beam"}));
  app->add_option("--lens", options->lens, "of about so many nodes")
      ->check(CLI::IsMember(lens_names()))
      ->capture_default_str();
  app->add_option("--count", options->count, "faces opened, then elements subdivided")
      ->check(CLI::Range(20, 20000))
      ->capture_default_str();
  app->add_option("--json", options->json, "figures to this file");
  add_force_option(*app, options->force);
  app->footer("Example: haptic chart cut --quick --json build/cut.json");
  return {app, [options, app] { return chart_cut(*options, *app); }};
}

}  // namespace hapticd
