// haptic chart removal: what removing an element, or a cut, costs each method, its table, figures and
// picture.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <sstream>

#include "server/os/realtime.h"
#include "tools/chart/chart.h"
#include "tools/chart/removal/chart_removal.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

struct RemovalOptions {
  ChartSettings settings;
  std::vector<std::string> sizes = lens_names();
  std::vector<std::string> methods;
  int removals = 2000;
  bool quick = false, cut = false;
  std::string json, csv, out;
  bool force = false;
};

std::string key_of(const std::string& method, const std::string& order) {
  return order == "metis" ? method + "_metis" : method;
}

constexpr const char* csv_header =
    "method,order,nodes,tets,removed,update_us_median,update_us_p99,condense_us_median,step_us_median,"
    "timed,patch_nodes,w_rel_error,memory_mb\n";

std::string to_csv(const std::vector<RemovalPoint>& points) {
  std::ostringstream csv;
  csv << csv_header;
  for (const RemovalPoint& p : points)
    csv << p.method << ',' << p.order << ',' << p.nodes << ',' << p.tets << ',' << p.removed << ','
        << p.update_us_median << ',' << p.update_us_p99 << ',' << p.condense_us_median << ','
        << p.step_us_median << ',' << p.timed << ',' << p.patch_nodes << ',' << p.w_rel_error << ','
        << p.memory_mb << '\n';
  return csv.str();
}

nlohmann::ordered_json to_json(const RemovalChart& chart, const std::vector<ChartMethod>& methods,
                               const std::vector<int>& nodes, const RemovalOptions& options) {
  nlohmann::ordered_json json;
  json["command"] = "chart removal";
  json["what"] = options.cut ? "cuts" : "removals";
  json["removals"] = options.removals;
  json["zone_nodes"] = options.settings.zone_nodes;
  for (const RemovalPoint& p : chart.points)
    json["points"].push_back({{"method", p.method},
                              {"order", p.order},
                              {"nodes", p.nodes},
                              {"tets", p.tets},
                              {"removed", p.removed},
                              {"update_us_median", rounded(p.update_us_median, 2)},
                              {"update_us_p99", rounded(p.update_us_p99, 2)},
                              {"condense_us_median", rounded(p.condense_us_median, 2)},
                              {"step_us_median", rounded(p.step_us_median, 2)},
                              {"timed", p.timed},
                              {"patch_nodes", p.patch_nodes},
                              {"w_rel_error", p.w_rel_error},
                              {"memory_mb", rounded(p.memory_mb, 2)}});
  json["flatness"] = nlohmann::ordered_json::object();
  json["flatness_by_nodes"] = nlohmann::ordered_json::object();
  json["crossings"] = nlohmann::ordered_json::array();
  for (const int n : nodes) {
    nlohmann::ordered_json& of_size = json["flatness_by_nodes"][std::to_string(n)];
    for (const ChartMethod& m : methods)
      if (const auto ratio = flatness(chart.points, m.name, m.order, n)) {
        const std::string key = key_of(m.name, m.order);
        of_size[key] = rounded(*ratio, 3);
        const double worst = json["flatness"].value(key, 0.0);
        json["flatness"][key] = std::max(worst, rounded(*ratio, 3));
      }
    for (const char* method : {"exact", "zone"})
      if (const auto at = crossing(chart.points, method, "lazy", n))
        json["crossings"].push_back(
            {{"nodes", n}, {"method", method}, {"lazy_dearer_after", rounded(*at, 0)}});
  }
  for (const ReferenceCost& b : chart.bases)
    json["bases"].push_back({{"method", b.method},
                             {"order", b.order},
                             {"nodes", b.nodes},
                             {"made", b.made},
                             {"reference_ms_median", rounded(b.reference_ms_median, 2)},
                             {"adopt_us_max", rounded(b.adopt_us_max, 1)}});
  return json;
}

void print_chart(const RemovalChart& chart, bool cut) {
  std::printf("  %-20s %7s %8s %11s %11s %13s %9s %9s\n", "method", "nodes", cut ? "cuts" : "removed",
              "update µs", "p99 µs", "condense µs", "error", "MB");
  for (std::size_t i = 0; i < chart.points.size(); ++i) {
    const RemovalPoint& p = chart.points[i];
    const auto other = [&](std::size_t k) {
      return k >= chart.points.size() || chart.points[k].method != p.method ||
             chart.points[k].order != p.order || chart.points[k].nodes != p.nodes;
    };
    if (!other(i - 1) && !other(i + 1)) continue;  // the first and the last of each
    std::printf("  %-20s %7d %8d %11.1f %11.1f %13.1f %9.1e %9.1f\n", key_of(p.method, p.order).c_str(),
                p.nodes, p.removed, p.update_us_median, p.update_us_p99, p.condense_us_median, p.w_rel_error,
                p.memory_mb);
  }
}

std::vector<ChartMethod> chosen(const RemovalOptions& options) {
  std::vector<ChartMethod> result;
  for (const ChartMethod& m : chart_methods())
    if (options.methods.empty() ||
        std::count(options.methods.begin(), options.methods.end(), key_of(m.name, m.order)) > 0)
      result.push_back(m);
  return result;
}

struct Damaged {
  TissueModel model;
  std::vector<DamageStep> steps;
};

// A tenth of the body is left, so that there is always a patch; a cut mesh has the room that it needs.
Damaged damaged_lens(const std::string& size, const RemovalOptions& options) {
  constexpr int nodes_per_cut = 20, tets_per_node = 6;  // more than there are
  if (!options.cut) {
    TissueModel model = read_lens(size);
    const int most = std::min(options.removals, model.tet_count() * 9 / 10);
    std::vector<DamageStep> hole = growing_hole(model, most);
    return {std::move(model), std::move(hole)};
  }
  const int room = nodes_per_cut * options.removals;
  BladeWay way = way_of_blade(read_lens(size, {room, tets_per_node * room}), options.removals);
  return {read_lens(size, way.used), std::move(way.strips)};
}

int chart_removal(RemovalOptions& options, const CLI::App& app) {
  if (options.quick) {
    if (app.count("--sizes") == 0) options.sizes = {"1k"};
    if (app.count("--removals") == 0) options.removals = 200;
    options.settings.seconds_per_point = 1;
  }
  prepare_outputs("removal", csv_header, options.out, options.json, options.csv, options.force);
  keep_malloc_pages();

  const std::vector<ChartMethod> methods = chosen(options);
  RemovalChart chart;
  std::vector<int> nodes;
  {
    Progress progress("chart");
    // Large bodies take most of the time, about as their factor's operations: nodes².
    std::vector<Damaged> lenses;
    double whole = 0;
    const auto weight = [](const TissueModel& m) {
      return static_cast<double>(m.nodes_in_use) * m.nodes_in_use;
    };
    for (const std::string& size : options.sizes) {
      lenses.push_back(damaged_lens(size, options));
      whole += weight(lenses.back().model);
    }
    double before = 0;
    for (const auto& [model, steps] : lenses) {
      const int size = model.nodes_in_use;
      const double part = weight(model);
      nodes.push_back(size);
      RemovalChart of_size = chart_removals(
          model, steps, methods, options.settings, [&](double fraction, const std::string& what) {
            progress.show((before + fraction * part) / whole, std::to_string(size) + " nodes, " + what);
            return !interrupted();
          });
      std::move(of_size.points.begin(), of_size.points.end(), std::back_inserter(chart.points));
      std::move(of_size.bases.begin(), of_size.bases.end(), std::back_inserter(chart.bases));
      if (interrupted()) return 1;
      before += part;
    }
  }
  print_chart(chart, options.cut);
  if (!options.json.empty()) write_json(options.json, to_json(chart, methods, nodes, options));
  if (!options.csv.empty()) write_file(options.csv, to_csv(chart.points));
  if (!options.out.empty()) draw("plot_chart_removal.py", options.json, options.out + "/removal.png");
  return 0;
}

}  // namespace

Command add_chart_removal(CLI::App& chart) {
  auto options = std::make_shared<RemovalOptions>();
  CLI::App* app = chart.add_subcommand(
      "removal",
      "What removing an element, or a cut, costs every compliance method: the paper's Fig. 4, on three "
      "lenses.");
  std::vector<std::string> keys;
  for (const ChartMethod& m : chart_methods()) keys.push_back(key_of(m.name, m.order));
  app->add_flag("--quick", options->quick, "the smallest lens and 200 removals, half a minute");
  app->add_flag("--cut", options->cut, "a blade's cuts in place of removals");
  app->add_option("--sizes", options->sizes, "lenses, of about so many nodes")
      ->delimiter(',')
      ->check(CLI::IsMember(lens_names()))
      ->capture_default_str();
  app->add_option("--methods", options->methods, "only these")->delimiter(',')->check(CLI::IsMember(keys));
  app->add_option("--removals", options->removals, "elements removed, one by one; of a blade, cuts")
      ->check(CLI::Range(20, 100000))
      ->capture_default_str();
  app->add_option("--json", options->json, "figures to this file");
  app->add_option("--csv", options->csv, "the points to this file");
  app->add_option("--out", options->out, "removal.json, removal.csv and removal.png into this directory");
  add_force_option(*app, options->force);
  app->footer(
      "Example: haptic chart removal --sizes 1k,5k --removals 1000 --out build/chart\n"
      "         haptic chart removal --cut --sizes 1k,5k --out build/chart/cuts");
  return {app, [options, app] { return chart_removal(*options, *app); }};
}

}  // namespace hapticd
