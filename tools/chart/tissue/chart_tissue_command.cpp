// haptic chart tissue: the checks of tissue_check.h, and strokes into two lenses (stroke_trial.h).
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "tools/chart/chart.h"
#include "tools/chart/shard.h"
#include "tools/chart/tissue/tissue_check.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"
#include "tools/offline/stroke_trial.h"

namespace hapticd {

namespace {

struct Options {
  bool quick = false;
  std::vector<std::string> only;
  int stroke_steps = 0;  // 0: by effort
  std::string json, out;
  bool force = false;
  Shard shard;
};

struct StrokeCase {
  const char* name;
  const char* mesh;
  Law law;
};
constexpr StrokeCase stroke_cases[] = {{"strokes", "lens", Law::corotational},
                                       {"strokes_guarded", "lens", Law::guarded},
                                       {"strokes_graded", "lens_graded", Law::corotational},
                                       {"strokes_graded_guarded", "lens_graded", Law::guarded}};
constexpr const char* refinement_part = "stroke_steps";

std::vector<std::string> part_names() {
  std::vector<std::string> names;
  for (const TissueCheckGroup& group : tissue_check_groups()) names.push_back(group.name);
  for (const StrokeCase& c : stroke_cases) names.push_back(c.name);
  names.push_back(refinement_part);
  return names;
}

const char* name_of(Law law) { return law == Law::guarded ? "guarded" : "corotational"; }

struct StrokeRow {
  StrokeSettings settings;
  StrokeReport report;
};

// Forces of one stroke without removals at a step, against those of the finest step and of half of it.
struct Refinement {
  std::string mesh;
  Law law;
  double depth, h, difference, from_half;  // rms over the other's rms; from_half: 0 where none was run
  int inverted_steps;                      // of the finest one
};
constexpr std::array<double, 5> refined_steps = {20e-3, 8e-3, 4e-3, 2e-3, 1e-3};

struct Strokes {
  std::vector<StrokeRow> rows;
  std::vector<Refinement> refinements;
};

double rms_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double off = 0, whole = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    off += (a[i] - b[i]) * (a[i] - b[i]);
    whole += b[i] * b[i];
  }
  return std::sqrt(off / whole);
}

// A burst: a millisecond that changes the force by half of the largest there is.
constexpr double burst = 0.5;

// Of a first-order method: what halving the step changes is what is left of the error.
constexpr double converged = 0.015;

void check_strokes(const StrokeRow& row, TissueFindings& findings) {
  const StrokeReport& r = row.report;
  const std::string name = "strokes of 2 mm, " + row.settings.mesh + ", " + name_of(row.settings.law) + ": ";
  const char* source = "no NaN, no burst, and rest after it";
  findings.check(name + "numbers that are none, and refusals", 0, r.not_finite + r.refused, 0, source);
  findings.check(name + "force left when the tip is clear [N]", 0, r.left_after, 1e-6, source);
  findings.check(name + "largest change in 1 ms over the peak", 0, r.largest_change / r.peak, burst, source);
}

// Inside out nothing converges, and nothing is claimed.
void check_refinement(const Refinement& r, TissueFindings& findings) {
  const std::string name = (r.depth < 1.5e-3 ? "a stroke of 1 mm, " : "a stroke of 2 mm, ") + r.mesh + ", " +
                           name_of(r.law) + ": force at steps of 2 ms against 1 ms";
  if (r.inverted_steps > 0)
    findings.skipped.push_back(name + ": some element is inside out in " + std::to_string(r.inverted_steps) +
                               " of the finest run's steps");
  else
    findings.check(name, 0, r.from_half, converged, "half-step reference");
}

template <class Wanted, class Made, class Progress>
Strokes run_strokes_wanted(const Options& options, Wanted wanted, Made made, Progress progress,
                           TissueFindings& findings) {
  Strokes strokes;
  StrokeSettings base;
  base.steps = options.stroke_steps > 0 ? options.stroke_steps : options.quick ? 130 : 10000;
  const auto alive = [&](const std::string& what) {
    return [&progress, what](double fraction) {
      progress(fraction, what);
      return !interrupted();
    };
  };
  for (const StrokeCase& c : stroke_cases) {
    if (!wanted(c.name)) continue;
    StrokeRow row{base, {}};
    row.settings.mesh = c.mesh;
    row.settings.law = c.law;
    row.report = run_strokes(row.settings, false, alive(c.name));
    if (interrupted()) return strokes;
    check_strokes(row, findings);
    strokes.rows.push_back(std::move(row));
    made(strokes);
  }
  if (options.quick || !wanted(refinement_part)) return strokes;
  for (const StrokeCase& c : stroke_cases)
    for (const double depth : {1e-3, 2e-3}) {
      StrokeSettings one = base;
      one.mesh = c.mesh;
      one.law = c.law;
      one.depth = depth;
      one.removal = false;
      std::vector<StrokeReport> by_step;
      for (const double h : refined_steps) {
        one.h = h;
        one.steps = static_cast<int>(std::lround(0.52 / h));
        one.episode = one.steps;
        by_step.push_back(run_strokes(one, true, alive("half steps")));
        if (interrupted()) return strokes;
      }
      const StrokeReport& finest = by_step.back();
      for (std::size_t k = 0; k + 1 < refined_steps.size(); ++k) {
        const bool halved = refined_steps[k] == 2 * refined_steps[k + 1];
        strokes.refinements.push_back(
            {c.mesh, c.law, depth, refined_steps[k], rms_difference(by_step[k].force, finest.force),
             halved ? rms_difference(by_step[k].force, by_step[k + 1].force) : 0, finest.inverted_steps});
      }
      check_refinement(strokes.refinements.back(), findings);
    }
  made(strokes);
  return strokes;
}

void add_json(nlohmann::ordered_json& json, const Strokes& strokes) {
  for (const StrokeRow& row : strokes.rows) {
    const StrokeReport& r = row.report;
    json["strokes"].push_back({{"mesh", row.settings.mesh},
                               {"law", name_of(row.settings.law)},
                               {"steps", r.steps},
                               {"removed", r.removed},
                               {"not_finite", r.not_finite},
                               {"refused", r.refused},
                               {"solver_caps", r.solver_caps},
                               {"peak_n", r.peak},
                               {"largest_change_n_per_ms", r.largest_change},
                               {"largest_change_without_handover_n_per_ms", r.largest_change_in_step},
                               {"change_p99_9_n_per_ms", r.change_p999},
                               {"left_when_clear_n", r.left_after},
                               {"inverted_steps", r.inverted_steps},
                               {"most_inverted", r.most_inverted},
                               {"least_det_f", r.least_volume}});
  }
  for (const Refinement& r : strokes.refinements)
    json["stroke_steps"].push_back({{"mesh", r.mesh},
                                    {"law", name_of(r.law)},
                                    {"depth_mm", 1e3 * r.depth},
                                    {"h_ms", 1e3 * r.h},
                                    {"rms_difference", r.difference},
                                    {"rms_difference_from_half", r.from_half},  // 0: none was run
                                    {"inverted_steps", r.inverted_steps}});
}

void print_strokes(const Strokes& strokes) {
  for (const StrokeRow& row : strokes.rows) {
    const StrokeReport& r = row.report;
    std::printf(
        "  %-11s %-12s %5d steps, %4d removed: peak %.2f mN, largest change in 1 ms %.2f mN (%.2f within a "
        "step, p99.9 %.2f), inside out in %d steps (at most %d, least det F %.2f), %.1f ms a step\n",
        row.settings.mesh.c_str(), name_of(row.settings.law), r.steps, r.removed, 1e3 * r.peak,
        1e3 * r.largest_change, 1e3 * r.largest_change_in_step, 1e3 * r.change_p999, r.inverted_steps,
        r.most_inverted, r.least_volume, r.steps_ms);
  }
  for (const Refinement& r : strokes.refinements) {
    std::printf(
        "  %-11s %-12s %.1f mm, step %4.0f ms: %5.1f %% from a step of 1 ms (inside out in %d of its steps)",
        r.mesh.c_str(), name_of(r.law), 1e3 * r.depth, 1e3 * r.h, 100 * r.difference, r.inverted_steps);
    if (r.from_half > 0) std::printf(", %.1f %% from its half", 100 * r.from_half);
    std::printf("\n");
  }
}

nlohmann::ordered_json to_json(const TissueFindings& findings, ShardLedger& shard) {
  nlohmann::ordered_json json;
  json["command"] = "chart tissue";
  shard.prepare(json, {"checks", "skipped", "series", "locking", "strokes", "stroke_steps"},
                {"series", "locking", "strokes", "stroke_steps"});
  json["checks"] = nlohmann::ordered_json::array();
  for (const TissueCheck& c : findings.checks)
    json["checks"].push_back({{"name", c.name},
                              {"reference", c.reference},
                              {"value", c.value},
                              {"relative_error", c.relative_error},
                              {"tolerance", c.tolerance},
                              {"source", c.source},
                              {"passed", c.passed}});
  json["skipped"] = findings.skipped;
  for (const TissueSeries& s : findings.series)
    json["series"].push_back({{"name", s.name},
                              {"expected_order", s.expected_order},
                              {"order", rounded(order_of(s), 3)},
                              {"size", s.size},
                              {"error", s.error}});
  for (const LockingPoint& p : findings.locking)
    json["locking"].push_back({{"problem", p.problem},
                               {"remedy", p.remedy},
                               {"poisson", p.poisson},
                               {"size", p.size},
                               {"stiffness", p.stiffness},
                               {"operations", p.operations}});
  return json;
}

void print_checks(const TissueFindings& findings) {
  for (const TissueCheck& c : findings.checks)
    std::printf("  %-4s %-78s %12.6g %12.6g  %.1e of %.0e\n", c.passed ? "ok" : "FAIL", c.name.c_str(),
                c.reference, c.value, c.relative_error, c.tolerance);
  for (const std::string& s : findings.skipped) std::printf("  skip %s\n", s.c_str());
}

int chart(Options options) {
  std::string no_table;
  prepare_outputs(options.shard.stem("tissue"), "", options.out, options.json, no_table, options.force);
  const Effort effort = options.quick ? Effort::quick : Effort::full;
  TissueFindings findings;
  Strokes strokes;
  ShardLedger shard(options.shard);
  // A unit is what --only names.
  const auto wanted = [&](const std::string& part) {
    return (options.only.empty() || std::count(options.only.begin(), options.only.end(), part) > 0) &&
           shard.begins();
  };
  const auto made = [&](const Strokes& so_far) {
    shard.made("checks", findings.checks.size());
    shard.made("skipped", findings.skipped.size());
    shard.made("series", findings.series.size());
    shard.made("locking", findings.locking.size());
    shard.made("strokes", so_far.rows.size());
    shard.made("stroke_steps", so_far.refinements.size());
  };
  {
    Progress progress("chart");
    const auto& groups = tissue_check_groups();
    for (std::size_t g = 0; g < groups.size() && !interrupted(); ++g) {
      if (!wanted(groups[g].name)) continue;
      progress.show(static_cast<double>(g) / static_cast<double>(groups.size()), groups[g].name);
      groups[g].run(effort, findings);
      made(strokes);
    }
    strokes = run_strokes_wanted(
        options, wanted, made,
        [&](double fraction, const std::string& what) { progress.show(fraction, what); }, findings);
  }
  if (interrupted()) return 1;
  print_checks(findings);
  print_strokes(strokes);
  nlohmann::ordered_json json = to_json(findings, shard);
  add_json(json, strokes);
  shard.note(json);
  if (!options.json.empty()) write_json(options.json, json);
  if (!options.out.empty() && options.shard.is_whole())
    draw("plot_chart_tissue.py", options.json, options.out + "/tissue.png");
  const auto failed = std::count_if(findings.checks.begin(), findings.checks.end(),
                                    [](const TissueCheck& c) { return !c.passed; });
  std::printf("%zu checks, %d failed, %zu skipped\n", findings.checks.size(), static_cast<int>(failed),
              findings.skipped.size());
  return failed == 0 ? 0 : 1;
}

}  // namespace

Command add_chart_tissue(CLI::App& chart_app) {
  auto options = std::make_shared<Options>();
  CLI::App* app = chart_app.add_subcommand(
      "tissue", "Whether the tissue is true: checks against solutions that others found; 1 if any fails.");
  app->add_flag("--quick", options->quick, "coarser meshes, seconds instead of minutes");
  app->add_option("--only", options->only, "only these parts")
      ->delimiter(',')
      ->check(CLI::IsMember(part_names()));
  app->add_option("--stroke-steps", options->stroke_steps,
                  "simulation steps of the strokes, each lens and law")
      ->check(CLI::Range(20, 1000000));
  app->add_option("--json", options->json, "figures to this file");
  app->add_option("--out", options->out, "tissue.json and tissue.png into this directory");
  add_force_option(*app, options->force);
  add_shard_option(*app, options->shard);
  app->footer("Example: haptic chart tissue --quick --out build/chart");
  return {app, [options] { return chart(*options); }};
}

}  // namespace hapticd
