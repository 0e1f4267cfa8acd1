// haptic chart step: what the parts of the 50 Hz step cost. So far the factorisation (chart_factor.h).
#include <algorithm>
#include <cstdio>
#include <memory>

#include "physics/compliance/compliance.h"
#include "tools/chart.h"
#include "tools/chart_factor.h"
#include "tools/command.h"
#include "tools/report.h"

namespace hapticd {

namespace {

struct Options {
  std::string json;
  std::string lens = "1k";
  int zone = 60;
  int repeats = 51;
};

int chart(const Options& options) {
  const TissueModel model = read_lens(options.lens);
  make_exact_compliance(model, 0.02);  // sets OpenBLAS to one thread
  const FactorFigures f = chart_factor(model, options.zone, options.repeats);
  print({{"nodes, of the zone", std::to_string(f.nodes) + ", " + std::to_string(f.zone_nodes)},
         {"own factor, " + f.kernels, fixed(f.own_ms, 2) + " ms"},
         {"CHOLMOD", fixed(f.cholmod_ms, 2) + " ms, " + fixed(f.cholmod_ms / f.own_ms, 2) + " times"},
         {"own plan, CHOLMOD's", fixed(f.plan_ms, 2) + ", " + fixed(f.cholmod_plan_ms, 2) + " ms"}});
  std::printf("residual %.1e, CHOLMOD's %.1e\n", f.own_residual, f.cholmod_residual);
  if (!options.json.empty()) {
    nlohmann::ordered_json json;
    json["command"] = "chart step";
    json["factor"] = {{"nodes", f.nodes},
                      {"zone_nodes", f.zone_nodes},
                      {"kernels", f.kernels},
                      {"own_ms", rounded(f.own_ms, 3)},
                      {"cholmod_ms", rounded(f.cholmod_ms, 3)},
                      {"own_plan_ms", rounded(f.plan_ms, 3)},
                      {"cholmod_plan_ms", rounded(f.cholmod_plan_ms, 3)},
                      {"own_residual", f.own_residual},
                      {"cholmod_residual", f.cholmod_residual}};
    write_json(options.json, json);
  }
  return 0;
}

}  // namespace

Command add_chart_step(CLI::App& chart_app) {
  auto options = std::make_shared<Options>();
  CLI::App* app =
      chart_app.add_subcommand("step", "What the parts of a step cost: the factor, against CHOLMOD.");
  app->add_option("--json", options->json, "figures to this file");
  app->add_option("--lens", options->lens, "1k, 5k or 20k")->check(CLI::IsMember(lens_names()));
  app->add_option("--zone", options->zone, "nodes ordered last")->check(CLI::Range(0, 1000));
  app->add_option("--repeats", options->repeats, "factorisations timed")->check(CLI::Range(1, 100000));
  app->footer("Example: haptic chart step --json step.json");
  return {app, [options] { return chart(*options); }};
}

}  // namespace hapticd
