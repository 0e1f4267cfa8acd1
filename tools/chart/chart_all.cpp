// haptic chart all: every chart there is, and one page with all of them that needs no other file.
//
// Each chart is run as a program of its own, so that what one leaves in memory and caches does not colour the
// next. A chart that fails is said so on the page and in the exit code; the others are still made.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <memory>

#include "server/files/paths.h"
#include "tools/chart/chart.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

// In the order of the page. Seconds: about, for the time left.
struct Entry {
  const char* name;
  std::vector<std::string> quick, whole;
  double quick_s, whole_s;
};

const std::vector<Entry>& charts() {
  static const std::vector<Entry> entries = {{"force", {"--quick"}, {}, 25, 900},
                                             {"economy", {"--quick"}, {}, 15, 60},
                                             {"step", {"--quick"}, {}, 45, 600},
                                             {"tissue", {"--quick"}, {}, 30, 1500},
                                             {"removal", {"--quick"}, {}, 15, 600},
                                             {"cut", {"--quick"}, {}, 60, 300},
                                             {"warping", {}, {}, 10, 10},
                                             {"lcp", {"--quick"}, {}, 60, 1200},
                                             {"pieces", {"--quick"}, {"--steps", "2000"}, 120, 1200}};
  return entries;
}

struct Options {
  std::string out, json;
  bool quick = false, force = false;
};

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Processes that ran or wanted to, the mean of a minute.
double load() {
  double mean[1] = {0};
  return getloadavg(mean, 1) == 1 ? rounded(mean[0], 2) : 0;
}

int chart_all(const Options& options, const CLI::App& chart) {
  const std::filesystem::path out = options.out;
  const OutputRule rule(options.force);
  rule.require_figures_folder("--out", out, "charts.json", "report");
  rule.require_figures("--json", options.json);
  std::filesystem::create_directories(out);
  double whole = 0, done = 0;
  for (const Entry& e : charts()) whole += options.quick ? e.quick_s : e.whole_s;
  nlohmann::ordered_json json;
  json["command"] = "chart all";
  json["quick"] = options.quick;
  const std::time_t now = std::time(nullptr);
  char date[32] = "";
  std::strftime(date, sizeof date, "%Y-%m-%d %H:%M UTC", std::gmtime(&now));
  json["date"] = date;
  json["load_before"] = load();
  bool all_made = true;
  const auto begun = std::chrono::steady_clock::now();
  {
    Progress progress("charts");
    for (const Entry& e : charts()) {
      progress.show(done / whole, e.name);
      const std::string folder = (out / e.name).string();
      const bool draws = chart.get_subcommand(e.name)->get_option_no_throw("--out") != nullptr;
      std::vector<std::string> words = {"/proc/self/exe", "chart", e.name, draws ? "--out" : "--json",
                                        draws ? folder : folder + "/" + e.name + ".json"};
      std::filesystem::create_directories(folder);
      words[0] = std::filesystem::read_symlink("/proc/self/exe").string();
      const auto& extra = options.quick ? e.quick : e.whole;
      words.insert(words.end(), extra.begin(), extra.end());
      if (options.force) words.push_back("--force");
      const auto start = std::chrono::steady_clock::now();
      const int code = run_program(words);
      if (interrupted()) return 1;
      json["charts"].push_back(
          {{"name", e.name}, {"seconds", rounded(seconds_since(start), 1)}, {"exit_code", code}});
      all_made = all_made && code == 0;
      done += options.quick ? e.quick_s : e.whole_s;
    }
  }
  json["seconds"] = rounded(seconds_since(begun), 1);
  json["load_after"] = load();
  const std::string list = (out / "charts.json").string();
  write_json(list, json);
  if (!options.json.empty()) write_json(options.json, json);
  draw("chart_report.py", list, (out / "report.html").string());
  std::printf("%s\n", (out / "report.html").c_str());
  return all_made ? 0 : 1;
}

}  // namespace

Command add_chart_all(CLI::App& chart_app) {
  auto options = std::make_shared<Options>();
  CLI::App* app = chart_app.add_subcommand("all", "Every chart, and one self-contained report.html.");
  app->add_option("--out", options->out, "report.html, and a folder for each chart")->required();
  app->add_flag("--quick", options->quick, "each as quick as it can be: five minutes on two cores");
  app->add_option("--json", options->json, "what was run, how long it took, and whether it did");
  add_force_option(*app, options->force);
  app->footer("Example: haptic chart all --quick --out build/chart");
  return {app, [options, &chart_app] { return chart_all(*options, chart_app); }};
}

}  // namespace hapticd
