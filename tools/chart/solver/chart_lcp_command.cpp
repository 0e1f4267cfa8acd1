// haptic chart lcp: the command around chart_lcp.h and the replay of captured problems.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>

#include "server/record/contact_capture_file.h"
#include "tools/chart/chart.h"
#include "tools/chart/shard.h"
#include "tools/chart/solver/chart_captures.h"
#include "tools/chart/solver/chart_lcp.h"
#include "tools/chart/solver/chart_lcp_ticks.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"

namespace hapticd {
namespace {

struct Options {
  LcpChartSettings settings;
  LcpTickSettings ticks;
  std::vector<std::string> cases = lcp_case_names();
  std::vector<int> contacts = {10, 30, 100}, rows = {10, 30, 100, 300};
  bool quick = false;
  std::string json, csv, out, from;
  Shard shard;
  bool force = false;
};

nlohmann::ordered_json to_json(const LcpPoint& p) {
  nlohmann::ordered_json json = {{"solver", p.solver},
                                 {"rows", p.rows},
                                 {"contacts", p.contacts},
                                 {"friction", p.friction},
                                 {"case", p.kind},
                                 {"warm", p.warm},
                                 {"steps", p.steps},
                                 {"us_median", rounded(p.us.p50, 2)},
                                 {"us_p99", rounded(p.us.p99, 2)},
                                 {"us_p99_9", rounded(p.us.p99_9, 2)},
                                 {"us_max", rounded(p.us.max, 2)},
                                 {"residual_median", p.residual_median},
                                 {"residual_max", p.residual_max},
                                 {"failures", p.failures},
                                 {"capped", p.capped},
                                 {"solved_but_wrong", p.solved_but_wrong},
                                 {"raised", p.raised},
                                 {"active_median", p.active_median},
                                 {"active_max", p.active_max}};
  if (p.wrench_error.count > 0) {
    json["wrench_error_median"] = p.wrench_error.p50;
    json["wrench_error_p99"] = p.wrench_error.p99;
    json["wrench_error"] = p.wrench_error.max;
  }
  return json;
}

nlohmann::ordered_json to_json(const LcpTickPoint& p) {
  return {{"case", p.kind},
          {"strokes", p.strokes},
          {"ticks", p.ticks},
          {"capped", p.capped},
          {"unusable_ticks", p.unusable},
          {"longest_unusable_ticks", p.longest_unusable},
          {"unusable_in_full", p.unusable_in_full},
          {"force_error_rms", rounded(p.force_error_rms, 5)},
          {"force_error_of_largest", rounded(p.force_error_of_largest, 5)},
          {"moved_rms", rounded(p.moved_rms, 5)},
          {"full_force_max", rounded(p.full_force_max, 4)},
          {"full_us_median", rounded(p.full_us_median, 1)},
          {"full_us_p99", rounded(p.full_us_p99, 1)}};
}

nlohmann::ordered_json to_json(const LcpChart& chart, const Options& options, ShardLedger& shard) {
  nlohmann::ordered_json json;
  json["command"] = "chart lcp";
  json["seed"] = options.settings.seed;
  shard.prepare(json, {"points", "regularisation", "ticks"}, {"regularisation", "ticks"});
  json["points"] = nlohmann::ordered_json::array();
  for (const LcpPoint& p : chart.points) json["points"].push_back(to_json(p));
  for (const RegularisationPoint& r : chart.regularisation)
    json["regularisation"].push_back({{"case", "rigid"},
                                      {"contacts", r.contacts},
                                      {"compared", r.compared},
                                      {"unsolved_without", r.unsolved},
                                      {"wrench_change_median", r.wrench_change.p50},
                                      {"wrench_change_p99", r.wrench_change.p99},
                                      {"wrench_change_max", r.wrench_change.max}});
  return json;
}

constexpr const char* csv_header =
    "solver,rows,contacts,friction,case,warm,steps,us_median,us_p99,us_p99_9,us_max,residual_median,"
    "residual_max,failures,capped,solved_but_wrong,raised,active_median,active_max,wrench_error_median,"
    "wrench_error_p99,wrench_error\n";

std::string to_csv(const std::vector<LcpPoint>& points) {
  std::ostringstream csv;
  csv << csv_header;
  for (const LcpPoint& p : points)
    csv << p.solver << ',' << p.rows << ',' << p.contacts << ',' << p.friction << ',' << p.kind << ','
        << p.warm << ',' << p.steps << ',' << p.us.p50 << ',' << p.us.p99 << ',' << p.us.p99_9 << ','
        << p.us.max << ',' << p.residual_median << ',' << p.residual_max << ',' << p.failures << ','
        << p.capped << ',' << p.solved_but_wrong << ',' << p.raised << ',' << p.active_median << ','
        << p.active_max << ',' << p.wrench_error.p50 << ',' << p.wrench_error.p99 << ',' << p.wrench_error.max
        << '\n';
  return csv.str();
}

void print_points(const std::vector<LcpPoint>& points) {
  std::printf("  %-19s %-15s %4s %8s %5s %9s %9s %9s %8s %6s %5s %9s\n", "solver", "case", "rows", "active",
              "", "µs", "p99 µs", "residual", "failures", "capped", "wrong", "wrench");
  for (const LcpPoint& p : points)
    std::printf("  %-19s %-15s %4d %3.0f/%-4.0f %5s %8.1f %8.1f %9.1e %8d %6d %5d %9.1e\n", p.solver.c_str(),
                p.kind.c_str(), p.rows, p.active_median, p.active_max, p.warm ? "warm" : "cold", p.us.p50,
                p.us.p99, p.residual_max, p.failures, p.capped, p.solved_but_wrong, p.wrench_error.p99);
}

void print_ticks(const std::vector<LcpTickPoint>& points) {
  for (const LcpTickPoint& p : points)
    std::printf(
        "  %s, %d ticks within the budget: %d capped, %d unusable, at most %d in a row; force off by %.2g "
        "RMS, "
        "%.2g of the largest (a micrometre sideways: %.2g RMS; %.2g N; in full p99 %.0f µs, %d unusable)\n",
        p.kind.c_str(), p.ticks, p.capped, p.unusable, p.longest_unusable, p.force_error_rms,
        p.force_error_of_largest, p.moved_rms, p.full_force_max, p.full_us_p99, p.unusable_in_full);
}

void write_all(const Options& options, const nlohmann::ordered_json& json,
               const std::vector<LcpPoint>& points) {
  if (!options.json.empty()) write_json(options.json, json);
  if (!options.csv.empty()) write_file(options.csv, to_csv(points));
  if (!options.out.empty() && options.shard.is_whole())
    draw("plot_chart_lcp.py", options.json, options.out + "/lcp.png");
}

int run_captured(const Options& options) {
  const std::vector<std::filesystem::path> files = capture_files(options.from);
  CaptureChart chart;
  {
    Progress progress("chart");
    chart = chart_captures(files, [&](double fraction) {
      progress.show(fraction, "captured problems");
      return !interrupted();
    });
    if (interrupted()) return 1;
  }
  ShardLedger whole;
  LcpChart points;
  points.points = chart.points;
  nlohmann::ordered_json json = to_json(points, options, whole);
  std::size_t unsolved = 0;
  for (const CaptureReport& c : chart.captures) {
    json["captures"].push_back({{"file", c.file},
                                {"rows", c.rows},
                                {"contacts", c.contacts},
                                {"active", c.active},
                                {"friction", c.friction},
                                {"solved_then", c.solved_then},
                                {"solved", c.solved},
                                {"residual_then", c.residual_then},
                                {"residual", c.residual},
                                {"wrench_difference", c.wrench_difference},
                                {"penetration_um", rounded(c.penetration_um, 3)}});
    unsolved += !c.solved;
    if (!c.solved)
      std::printf("  %s: %d rows, %d active, residual %.1e (then %.1e)\n", c.file.c_str(), c.rows, c.active,
                  c.residual, c.residual_then);
  }
  std::printf("  %zu problems, %zu not solved from their recorded state\n", chart.captures.size(), unsolved);
  print_points(chart.points);
  write_all(options, json, chart.points);
  return 0;
}

int run(Options& options, const CLI::App& app) {
  if (options.quick) {
    if (app.count("--steps") == 0) options.settings.steps = 1000;
    if (app.count("--contacts") == 0) options.contacts = {10, 30};
    if (app.count("--rows") == 0) options.rows = {10, 100};
    if (app.count("--strokes") == 0) options.ticks.strokes = 2;
  }
  options.settings.peer_steps = std::min(options.settings.peer_steps, options.settings.steps);
  prepare_outputs(options.shard.stem("lcp"), csv_header, options.out, options.json, options.csv,
                  options.force);
  if (!options.from.empty() && !options.shard.is_whole())
    throw UsageError("--shard: not of captured problems (--from)");
  if (!options.from.empty()) return run_captured(options);

  struct Run {
    bool friction;
    int size;
    std::string kind;
    double weight;
  };
  std::vector<Run> runs;
  double whole = 0, before = 0;
  const auto plan = [&](bool friction, const std::vector<int>& sizes) {
    for (const int size : sizes)
      for (const std::string& kind : options.cases) {
        runs.push_back({friction, size, kind, (friction ? 30.0 : 1.0) * size});
        whole += runs.back().weight;
      }
  };
  plan(false, options.rows);
  plan(true, options.contacts);

  options.ticks.seed = options.settings.seed;
  const double of_ticks = 30.0 * options.ticks.strokes;
  std::vector<std::string> tick_cases;
  for (const std::string& kind : lcp_tick_case_names())
    if (std::count(options.cases.begin(), options.cases.end(), kind) > 0) tick_cases.push_back(kind);
  whole += of_ticks * static_cast<double>(tick_cases.size());

  LcpChart chart;
  std::vector<LcpTickPoint> ticks;
  ShardLedger shard(options.shard);
  {
    Progress progress("chart");
    for (const std::string& kind : tick_cases) {
      if (!shard.begins()) continue;
      ticks.push_back(chart_lcp_ticks(kind, options.ticks, [&](double fraction) {
        progress.show((before + fraction * of_ticks) / whole, kind + ", ticks");
        return !interrupted();
      }));
      if (interrupted()) return 1;
      shard.made("ticks", ticks.size());
      before += of_ticks;
    }
    for (const Run& r : runs) {
      if (!shard.begins()) continue;
      const std::string words = r.kind + ", " + std::to_string(r.size) + (r.friction ? " contacts" : " rows");
      chart_case(
          r.kind, r.size, r.friction, options.settings,
          [&](double fraction) {
            progress.show((before + fraction * r.weight) / whole, words);
            return !interrupted();
          },
          chart);
      if (interrupted()) return 1;
      shard.made("points", chart.points.size());
      shard.made("regularisation", chart.regularisation.size());
      before += r.weight;
    }
  }
  print_points(chart.points);
  for (const RegularisationPoint& r : chart.regularisation)
    std::printf(
        "  rigid, %d contacts: its compliance changes the wrench by %.2g in the median, p99 %.2g (%d "
        "compared, "
        "%d unsolved without)\n",
        r.contacts, r.wrench_change.p50, r.wrench_change.p99, r.compared, r.unsolved);
  print_ticks(ticks);
  nlohmann::ordered_json json = to_json(chart, options, shard);
  for (const LcpTickPoint& p : ticks) json["ticks"].push_back(to_json(p));
  shard.note(json);
  write_all(options, json, chart.points);
  return 0;
}

}  // namespace

Command add_chart_lcp(CLI::App& chart) {
  auto options = std::make_shared<Options>();
  CLI::App* app =
      chart.add_subcommand("lcp", "Time against residual of the contact solvers, on seeded strokes.");
  app->add_flag("--quick", options->quick, "1000 steps and the smaller sizes, half a minute");
  app->add_option("--cases", options->cases, "only these")
      ->delimiter(',')
      ->check(CLI::IsMember(lcp_case_names()))
      ->capture_default_str();
  app->add_option("--contacts", options->contacts, "with friction, three rows each")
      ->delimiter(',')
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app->add_option("--rows", options->rows, "without friction, one row a contact")
      ->delimiter(',')
      ->check(CLI::Range(1, 300))
      ->capture_default_str();
  app->add_option("--steps", options->settings.steps, "problems of each case")
      ->check(CLI::Range(20, 1000000))
      ->capture_default_str();
  app->add_option("--strokes", options->ticks.strokes, "of 600 haptic ticks, within the daemon's budget")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app->add_option("--seed", options->settings.seed, "of the strokes")->capture_default_str();
  app->add_option("--from", options->from, "solves the problems of `hapticd --capture DIR` instead");
  app->add_option("--json", options->json, "figures to this file");
  app->add_option("--csv", options->csv, "the points to this file");
  app->add_option("--out", options->out, "lcp.json, lcp.csv and lcp.png into this directory");
  add_force_option(*app, options->force);
  add_shard_option(*app, options->shard);
  app->footer("Example: haptic chart lcp --cases flat,duplicates --contacts 30 --out build/chart");
  return {app, [options, app] { return run(*options, *app); }};
}

}  // namespace hapticd
