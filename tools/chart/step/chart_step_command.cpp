// haptic chart step: what a step costs, over size, model and compliance; what a haptic tick costs; and the
// factorisation against CHOLMOD's (chart_step.h, chart_tick.h, chart_factor.h).
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <set>
#include <utility>

#include "physics/compliance/compliance.h"
#include "server/os/realtime.h"
#include "tools/chart/chart.h"
#include "tools/chart/step/chart_factor.h"
#include "tools/chart/step/chart_step.h"
#include "tools/chart/step/chart_tick.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

constexpr double removals_per_s = 10;

struct Options {
  std::string json, out;
  bool force = false;
  std::vector<std::string> lenses, models, compliances;
  std::vector<std::string> parts = {"points", "tick", "factor"};
  bool quick = false, busy = false;
  std::vector<double> near;    // [mean edges]
  std::vector<double> speeds;  // [mm/s]
  double start_seconds = 6;
  std::string lens = "1k";
  int zone = 60;
  int repeats = 51;
  int steps = 0;
};

template <class T>
bool has(const std::vector<T>& of, const T& what) {
  return std::find(of.begin(), of.end(), what) != of.end();
}

std::vector<std::string> names_of_lenses() {
  std::vector<std::string> names;
  for (const StepLens& l : step_lenses()) names.push_back(l.name);
  return names;
}

std::vector<StepCase> cases_of(const Options& options) {
  std::vector<StepCase> cases;
  for (const StepLens& lens : step_lenses()) {
    if (options.lenses.empty()
            ? lens.name == "100k" || (options.quick && lens.name != "1k" && lens.name != "5k")
            : !has(options.lenses, lens.name))
      continue;
    for (const bool corotational : {true, false})
      for (const ComplianceMethod method : {ComplianceMethod::exact, ComplianceMethod::zone,
                                            ComplianceMethod::lazy, ComplianceMethod::updown}) {
        if (!options.models.empty() &&
            !has<std::string>(options.models, corotational ? "corotational" : "linear"))
          continue;
        if (!options.compliances.empty() && !has<std::string>(options.compliances, name_of(method))) continue;
        StepCase of;
        of.lens = lens;
        of.corotational = corotational;
        of.method = method;
        const bool zone = method == ComplianceMethod::zone;
        of.removals_per_s = zone ? removals_per_s : 0;
        of.steps = options.steps > 0 ? options.steps : options.quick ? 100 : zone ? 2000 : 500;
        of.seconds = options.quick ? 3 : zone ? 60 : 15;
        of.busy = options.busy;
        for (const double speed : options.speeds)
          for (const double near : options.near) {
            of.speed = 1e-3 * speed;
            of.near = near;
            of.start_seconds = options.start_seconds;
            cases.push_back(of);
          }
      }
  }
  return cases;
}

nlohmann::ordered_json to_json(const StepPoint& p) {
  nlohmann::ordered_json json = {{"nodes", p.nodes},
                                 {"tets", p.tets},
                                 {"model", p.model},
                                 {"compliance", p.compliance},
                                 {"patch_nodes", p.patch_nodes},
                                 {"contacts", p.contacts},
                                 {"active", p.active},
                                 {"friction", true},
                                 {"steps", p.steps},
                                 {"removed", p.removed},
                                 {"busy", p.busy},
                                 {"bases", p.bases},
                                 {"reference_ms_median", rounded(p.reference_ms_median, 2)},
                                 {"threads", p.threads},
                                 {"late_references", p.late_references},
                                 {"fallback_steps", p.fallback_steps},
                                 {"memory_mb", rounded(p.memory_mb, 1)},
                                 {"start_ms", rounded(p.start_ms, 1)},
                                 {"mm_per_s", rounded(1e3 * p.speed, 3)},
                                 {"near_edges", p.near},
                                 {"step_ms_median", rounded(p.step_ms_median, 3)},
                                 {"step_ms_p99", rounded(p.step_ms_p99, 3)},
                                 {"step_ms_max", rounded(p.step_ms_max, 3)},
                                 {"over_20ms", rounded(p.over_20ms, 5)}};
  if (p.near > 0) {
    json["near_mm"] = rounded(p.near_mm, 3);
    json["simulated_nodes"] = p.simulated;
    json["boundary_nodes"] = p.boundary;
    json["regions_entered"] = p.regions_entered;
    if (p.force_rms_rel) {
      json["force_rms_rel"] = rounded(*p.force_rms_rel, 5);
      json["force_max_rel"] = rounded(*p.force_max_rel, 5);
    }
  }
  for (std::size_t k = 0; k < p.parts_ms.size(); ++k)
    json["parts_ms"][name_of(static_cast<StepPart>(k))] = rounded(p.parts_ms[k], 3);
  json["fits_50hz"] = p.fits_50hz;
  return json;
}

// One value of `near` and of the speed a list: steps of unlike parts of the meshes do not compare.
nlohmann::ordered_json growth_of(const std::vector<StepPoint>& points, double near, double speed) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  const auto put = [](nlohmann::ordered_json& in, const char* key, const std::optional<double>& e) {
    in[key] = e ? nlohmann::ordered_json(rounded(*e, 2)) : nlohmann::ordered_json(nullptr);
  };
  for (const char* model : {"corotational", "linear"})
    for (const char* compliance : {"exact", "zone", "lazy", "updown"}) {
      nlohmann::ordered_json of = {{"model", model}, {"compliance", compliance}};
      put(of, "step", growth(points, model, compliance, near, speed, [](const StepPoint& p) {
            return p.step_ms_median;
          }));
      of["near_edges"] = near;
      of["mm_per_s"] = rounded(1e3 * speed, 3);
      if (of["step"].is_null()) continue;
      for (std::size_t k = 0; k < step_parts; ++k)
        put(of["parts"], name_of(static_cast<StepPart>(k)),
            growth(points, model, compliance, near, speed,
                   [k](const StepPoint& p) { return p.parts_ms[k]; }));
      json.push_back(of);
    }
  return json;
}

// The largest mesh whose tissue turns and is cut, and the part that takes most of its step.
nlohmann::ordered_json largest_of(const std::vector<StepPoint>& points) {
  const StepPoint* largest = nullptr;
  for (const StepPoint& p : points)
    if (p.fits_50hz && p.model == "corotational" && (!largest || p.nodes > largest->nodes)) largest = &p;
  if (!largest) return nullptr;
  const auto part = std::max_element(largest->parts_ms.begin(), largest->parts_ms.end());
  return {{"nodes", largest->nodes},
          {"tets", largest->tets},
          {"compliance", largest->compliance},
          {"bound_by", name_of(static_cast<StepPart>(part - largest->parts_ms.begin()))}};
}

nlohmann::ordered_json to_json(const TickFigures& t) {
  nlohmann::ordered_json json = {{"hands", t.hands},
                                 {"patch_nodes", t.patch_nodes},
                                 {"contacts", t.contacts},
                                 {"contacts_of_a_hand", t.least_contacts},
                                 {"active", t.active},
                                 {"friction", true},
                                 {"ticks", t.ticks},
                                 {"capped", t.capped},
                                 {"us_median", rounded(t.us_median, 1)},
                                 {"us_p99", rounded(t.us_p99, 1)},
                                 {"us_max", rounded(t.us_max, 1)},
                                 {"cpu_us_median", rounded(t.cpu_us_median, 1)},
                                 {"cpu_us_p99", rounded(t.cpu_us_p99, 1)}};
  for (std::size_t k = 0; k < t.parts_us.size(); ++k)
    json["parts_us"][name_of(static_cast<ContactPart>(k))] = rounded(t.parts_us[k], 2);
  return json;
}

nlohmann::ordered_json to_json(const FactorFigures& f) {
  return {{"nodes", f.nodes},
          {"zone_nodes", f.zone_nodes},
          {"kernels", f.kernels},
          {"own_ms", rounded(f.own_ms, 3)},
          {"cholmod_ms", rounded(f.cholmod_ms, 3)},
          {"own_plan_ms", rounded(f.plan_ms, 3)},
          {"cholmod_plan_ms", rounded(f.cholmod_plan_ms, 3)},
          {"own_residual", f.own_residual},
          {"cholmod_residual", f.cholmod_residual}};
}

void print_points(const std::vector<StepPoint>& points) {
  if (points.empty()) return;
  std::printf("%-13s %-7s %6s %5s %4s  %8s %8s %7s ", "model", "", "nodes", "patch", "con.", "p50 ms",
              "p99 ms", "> 20 ms");
  for (std::size_t k = 0; k < step_parts; ++k) std::printf(" %11s", name_of(static_cast<StepPart>(k)));
  std::printf("\n");
  for (const StepPoint& p : points) {
    std::printf("%-13s %-7s %6d %5d %4d  %8.2f %8.2f %5.1f %% ", p.model.c_str(), p.compliance.c_str(),
                p.nodes, p.patch_nodes, p.contacts, p.step_ms_median, p.step_ms_p99, 100 * p.over_20ms);
    for (const double part : p.parts_ms) std::printf(" %11.3f", part);
    if (p.near > 0)
      std::printf(
          "  %.0f mm/s, near %.2f mm: %d nodes, boundary %d, start %.1f s, %.0f MB, %d regions, %d late, %d "
          "steps rigid",
          1e3 * p.speed, p.near_mm, p.simulated, p.boundary, 1e-3 * p.start_ms, p.memory_mb,
          p.regions_entered, p.late_references, p.fallback_steps);
    if (p.force_rms_rel)
      std::printf(", force off %.2f %%, at most %.2f %%", 100 * *p.force_rms_rel, 100 * *p.force_max_rel);
    std::printf("\n");
  }
}

int chart(Options options) {
  keep_malloc_pages();
  catch_interrupts();
  const std::vector<StepCase> cases =
      has<std::string>(options.parts, "points") ? cases_of(options) : std::vector<StepCase>{};
  const bool ticks = has<std::string>(options.parts, "tick");
  const bool factor = has<std::string>(options.parts, "factor");
  std::vector<StepPoint> points;
  std::vector<TickFigures> tick;  // of one hand, of two
  FactorFigures f;
  {
    // In seconds, about: the time left is theirs.
    Progress progress("steps");
    const double tick_s = options.quick ? 2 : 8;  // of one hand, or two
    const double factor_s = 1;
    double whole = (ticks ? 2 * tick_s : 0) + (factor ? factor_s : 0);
    const auto seconds = [](const StepCase& of) { return std::min(of.seconds, 0.02 * of.steps) + 1; };
    for (const StepCase& of : cases) whole += seconds(of);
    double done = 0;
    const auto show = [&](double of_whole, double fraction, const std::string& what) {
      const double at = (done + fraction * of_whole) / whole;
      progress.show(at, fixed((1 - at) * whole, 0) + " s left, " + what);
      return !interrupted();
    };
    if (factor) {
      show(factor_s, 0, "factor");
      const TissueModel model = read_lens(options.lens);
      f = chart_factor(model, options.zone, options.repeats);
      done += factor_s;
    }
    for (int hands = 1; ticks && hands <= 2; ++hands) {
      TickSettings settings;
      settings.hands = hands;
      if (options.quick) settings.steps = 100;
      tick.push_back(
          chart_tick(settings, [&](double fraction) { return show(tick_s, fraction, "haptic tick"); }));
      done += tick_s;
    }
    for (const StepCase& of : cases) {
      const std::string what =
          of.lens.name + ", " + (of.corotational ? "corotational" : "linear") + ", " + name_of(of.method);
      if (!show(seconds(of), 0, what)) return 1;
      points.push_back(chart_step(of, [&](double fraction) { return show(seconds(of), fraction, what); }));
      done += seconds(of);
    }
  }
  if (interrupted()) return 1;
  compare_forces(points);
  print_points(points);
  if (factor) {
    print({{"nodes, of the zone", std::to_string(f.nodes) + ", " + std::to_string(f.zone_nodes)},
           {"own factor, " + f.kernels, fixed(f.own_ms, 2) + " ms"},
           {"CHOLMOD", fixed(f.cholmod_ms, 2) + " ms, " + fixed(f.cholmod_ms / f.own_ms, 2) + " times"},
           {"own plan, CHOLMOD's", fixed(f.plan_ms, 2) + ", " + fixed(f.cholmod_plan_ms, 2) + " ms"}});
    std::printf("residual %.1e, CHOLMOD's %.1e\n", f.own_residual, f.cholmod_residual);
  }
  for (const TickFigures& of : tick) {
    Table table = {{"haptic tick, hands " + std::to_string(of.hands) + ": patch, contacts (a hand), active",
                    std::to_string(of.patch_nodes) + ", " + std::to_string(of.contacts) + " (" +
                        std::to_string(of.least_contacts) + "), " + std::to_string(of.active)},
                   {"p50, p99, max; CPU p50, p99",
                    fixed(of.us_median, 0) + ", " + fixed(of.us_p99, 0) + ", " + fixed(of.us_max, 0) + "; " +
                        fixed(of.cpu_us_median, 0) + ", " + fixed(of.cpu_us_p99, 0) + " us"}};
    for (std::size_t k = 0; k < of.parts_us.size(); ++k)
      table.emplace_back(name_of(static_cast<ContactPart>(k)), fixed(of.parts_us[k], 1) + " us");
    print(table);
  }
  if (options.json.empty()) return 0;
  nlohmann::ordered_json json;
  json["command"] = "chart step";
  json["quick"] = options.quick;
  json["points"] = nlohmann::ordered_json::array();
  for (const StepPoint& p : points) json["points"].push_back(to_json(p));
  if (!points.empty()) {
    json["growth"] = nlohmann::ordered_json::array();
    std::set<std::pair<double, double>> kinds;
    for (const StepPoint& p : points) kinds.insert({p.near, p.speed});
    for (const auto& [near, speed] : kinds)
      for (const nlohmann::ordered_json& of : growth_of(points, near, speed)) json["growth"].push_back(of);
    json["largest_50hz"] = largest_of(points);
  }
  if (ticks) {
    json["tick"] = to_json(tick[0]);
    json["tick_of_two"] = to_json(tick[1]);
  }
  if (factor) json["factor"] = to_json(f);
  write_json(options.json, json);
  if (!options.out.empty() && !points.empty())
    draw("plot_chart_step.py", options.json, options.out + "/step.png");
  return 0;
}

}  // namespace

Command add_chart_step(CLI::App& chart_app) {
  auto options = std::make_shared<Options>();
  CLI::App* app = chart_app.add_subcommand(
      "step",
      "What a simulation step costs, part by part, over size, model and compliance; and a haptic tick.");
  app->add_option("--json", options->json, "figures to this file");
  app->add_option("--out", options->out, "step.json and step.png in this folder");
  add_force_option(*app, options->force);
  app->add_flag("--quick", options->quick, "two lenses and a hundred steps each: half a minute");
  app->add_option("--only", options->parts, "points, tick, factor")
      ->delimiter(',')
      ->check(CLI::IsMember({"points", "tick", "factor"}));
  app->add_option("--lenses", options->lenses, "of the points; all")
      ->delimiter(',')
      ->check(CLI::IsMember(names_of_lenses()));
  app->add_option("--models", options->models, "of the points; both")
      ->delimiter(',')
      ->check(CLI::IsMember({"linear", "corotational"}));
  app->add_option("--compliances", options->compliances, "of the points; all four")
      ->delimiter(',')
      ->check(CLI::IsMember({"exact", "zone", "lazy", "updown"}));
  app->add_flag("--busy", options->busy,
                "of the points, while another program computes on the simulation's core");
  app->add_option("--near", options->near,
                  "of the points: tissue within so many mean edges of the tip is simulated, the rest "
                  "condensed; 0, as without: all of it, which the others' forces are compared with")
      ->delimiter(',')
      ->check(CLI::Range(0.0, 1000.0));
  app->add_option("--speeds", options->speeds, "of the points' tip: mm/s; 3")
      ->delimiter(',')
      ->check(CLI::Range(0.1, 200.0));
  app->add_option("--start", options->start_seconds,
                  "of the points with --near: seconds to condense regions in before the tip comes, as a "
                  "daemon does; 6")
      ->check(CLI::Range(0.0, 3600.0));
  app->add_option("--steps", options->steps, "of each point, at most")->check(CLI::Range(1, 1000000));
  app->add_option("--lens", options->lens, "of the factor")->check(CLI::IsMember(names_of_lenses()));
  app->add_option("--zone", options->zone, "of the factor: nodes ordered last")->check(CLI::Range(0, 1000));
  app->add_option("--repeats", options->repeats, "of the factor")->check(CLI::Range(1, 100000));
  app->footer("Example: haptic chart step --out build/step");
  return {app, [options] {
            std::string no_table;
            if (options->near.empty()) options->near = {0};
            if (options->speeds.empty()) options->speeds = {3};
            prepare_outputs("step", "", options->out, options->json, no_table, options->force);
            return chart(*options);
          }};
}

}  // namespace hapticd
