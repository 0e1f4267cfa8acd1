// haptic chart warping: options, figures and picture of chart_warping.h.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>

#include "tools/chart/chart.h"
#include "tools/chart/removal/chart_warping.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

constexpr const char* warping_names[] = {"none", "node", "piece"};

constexpr const char* csv_header = "shape,amount,method,warping,largest_turn_rad,w_rel_error\n";

struct Options {
  std::string json, csv, out;
  bool force = false;
};

int chart(Options options) {
  prepare_outputs("warping", csv_header, options.out, options.json, options.csv, options.force);
  const TissueModel held = read_lens("1k");
  const TissueModel floating = make_tissue_model(held.mesh, held.material, {}, Vec3::Zero());
  std::vector<WarpingPoint> points;
  {
    Progress progress("chart");
    points = chart_warping(held, floating, {}, [&](double fraction, const std::string& what) {
      progress.show(fraction, what);
      return !interrupted();
    });
  }
  if (interrupted()) return 1;

  nlohmann::ordered_json json;
  json["command"] = "chart warping";
  std::ostringstream csv;
  csv << csv_header;
  std::printf("  %-12s %9s %11s %8s %8s %10s\n", "shape", "amount", "turn rad", "method", "warping", "error");
  for (const WarpingPoint& p : points) {
    const char* unit = p.shape == "indentation" ? "mm" : "deg";
    std::printf("  %-12s %5.1f %-3s %11.3f %8s %8s %10.1e\n", p.shape.c_str(), p.amount, unit, p.largest_turn,
                p.method.c_str(), warping_names[static_cast<int>(p.warping)], p.w_rel_error);
    json["points"].push_back({{"shape", p.shape},
                              {"amount", p.amount},
                              {"unit", unit},
                              {"method", p.method},
                              {"warping", warping_names[static_cast<int>(p.warping)]},
                              {"largest_turn_rad", rounded(p.largest_turn, 4)},
                              {"w_rel_error", p.w_rel_error}});
    csv << p.shape << ',' << p.amount << ',' << p.method << ',' << warping_names[static_cast<int>(p.warping)]
        << ',' << p.largest_turn << ',' << p.w_rel_error << '\n';
  }
  if (!options.json.empty()) write_json(options.json, json);
  if (!options.csv.empty()) write_file(options.csv, csv.str());
  if (!options.out.empty()) draw("plot_chart_warping.py", options.json, options.out + "/warping.png");
  return 0;
}

}  // namespace

Command add_chart_warping(CLI::App& chart_app) {
  auto options = std::make_shared<Options>();
  CLI::App* app = chart_app.add_subcommand(
      "warping", "What turning a stale compliance with its nodes is worth: error of C_pp with and without.");
  app->add_option("--json", options->json, "figures to this file");
  app->add_option("--csv", options->csv, "the points to this file");
  app->add_option("--out", options->out, "warping.json, warping.csv and warping.png into this directory");
  add_force_option(*app, options->force);
  app->footer("Example: haptic chart warping --out build/chart");
  return {app, [options] { return chart(*options); }};
}

}  // namespace hapticd
