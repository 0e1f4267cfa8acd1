#include "tools/soak/soak.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>

#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "server/os/realtime.h"
#include "server/scene/scene_reader.h"
#include "tools/chart/chart.h"
#include "tools/cli/child.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/soak/load.h"
#include "tools/soak/soak_report.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// Six slices of the same length: what a host takes comes in bursts of some seconds, and shall fall on daemon
// and tool alike.
constexpr double cycle_seconds = 12;
constexpr int slices_per_cycle = 6;

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

// One soak from start to end.
class Soak {
 public:
  Soak(const SoakOptions& options, const Scene& scene, const fs::path& scratch)
      : options_(options),
        scratch_(scratch),
        load_(options.load / 100),
        of_tick_(*trajectory_of(scene)),
        of_event_(trajectory_),
        core_(process_cores().back()),
        client_core_(process_cores().front()) {
    has_cyclictest_ = is_installed("cyclictest") && realtime_allowed();  // it ends without that right
    has_ddsperf_ = is_installed("ddsperf");
    tool_domain_ = options.client.domain + 2;
    record_.scene = options.scene;
    record_.mode = options.attach ? "attached" : options.mode;
    record_.duration = options.duration;
    record_.load = options.load;
    record_.own = !options.attach;
    if (options.attach) return;
    const std::uint32_t d = options.client.domain;
    if (options.mode != "event")
      tick_ = std::make_unique<SoakDaemon>(scene.file.string(), "tick", d, scratch);
    if (options.mode != "tick")
      event_ = std::make_unique<SoakDaemon>(scene.file.string(), "event", d + 1, scratch);
  }

  void run() {
    const int cycles = std::max(1, static_cast<int>(std::lround(options_.duration / cycle_seconds)));
    const double seconds = options_.duration / cycles;
    const CpuTimes before = cpu_times();
    Progress progress("soak");
    for (int c = 0; c < cycles && !interrupted(); ++c) {
      SoakFigures part =
          cycle(seconds, [&](const char* what, double done) { progress.show((c + done) / cycles, what); });
      if (c == 0) record_.first_rss_mb = part.rss_mb;
      record_.all.merge(part);
      const auto minute = static_cast<std::size_t>((c + 0.5) * seconds / 60);
      record_.minutes.resize(minute + 1);
      record_.minutes.back().merge(part);
    }
    if (interrupted()) throw std::runtime_error("interrupted");
    const CpuTimes after = cpu_times();
    const double total = after.busy + after.idle + after.steal - before.busy - before.idle - before.steal;
    record_.busy = (after.busy - before.busy) / total;
    record_.steal = (after.steal - before.steal) / total;
    for (const SoakDaemon* server : {tick_.get(), event_.get()})
      if (server) record_.summaries.push_back(server->last());
  }

  const SoakRecord& record() const { return record_; }

 private:
  const Trajectory* trajectory_of(const Scene& scene) {
    trajectory_ = read_trajectory(*scene.trajectory, LengthUnit::metre);
    return &trajectory_;
  }

  template <typename Show>
  SoakFigures cycle(double seconds, Show&& show) {
    SoakFigures f;
    const double slice = seconds / slices_per_cycle;
    auto progress = [&, n = 0](const char* what) mutable { show(what, double(n++) / slices_per_cycle); };
    for (const bool second : {false, true}) {
      progress("tick");
      add_tick(slice, f);
      progress("cyclictest");
      add_cyclictest(slice, f);
      progress(second ? "ddsperf" : "event");
      if (second)
        add_ddsperf(slice, f);
      else
        add_event(slice, f);
    }
    for (const SoakDaemon* server : {tick_.get(), event_.get()})
      if (server) f.rss_mb += server->resident_mb();
    return f;
  }

  bool attached(bool to_event) const { return options_.attach && (options_.mode == "event") == to_event; }
  void add_tick(double seconds, SoakFigures& f) {
    if (!tick_ && !attached(false)) return;
    const ServerFigures slice = client_slice(options_.client, client_core_, tick_.get(), of_tick_, seconds);
    f.tick.merge(slice);
    record_.wake_slices_us.push_back(slice.wake_us);
  }
  void add_event(double seconds, SoakFigures& f) {
    if (event_ || attached(true))
      f.event.merge(client_slice(options_.client, client_core_, event_.get(), of_event_, seconds));
  }
  void add_cyclictest(double seconds, SoakFigures& f) {
    if (!has_cyclictest_ || interrupted()) return;
    const Tally slice =
        with_hidden_wakeups(run_cyclictest(seconds, core_, haptic_priority, scratch_.string()));
    f.cyclictest_us.merge(slice);
    record_.cyclictest_slices_us.push_back(slice);
  }
  void add_ddsperf(double seconds, SoakFigures& f) {
    if (has_ddsperf_ && !interrupted())
      f.ddsperf.merge(
          run_ddsperf(seconds, core_, client_core_, static_cast<int>(tool_domain_), scratch_.string()));
  }

  SoakOptions options_;
  fs::path scratch_;
  Load load_;  // before anything makes threads
  Trajectory trajectory_;
  SwingSource of_tick_, of_event_;  // each daemon's motion goes on where it was
  // Of the haptic thread, cyclictest and pong; of the client and ping: a round trip within a core costs half
  // as much.
  int core_, client_core_;
  std::uint32_t tool_domain_ = 0;
  bool has_cyclictest_ = false, has_ddsperf_ = false;
  std::unique_ptr<SoakDaemon> tick_, event_;
  SoakRecord record_;
};

}  // namespace

int soak(SoakOptions options) {
  if (options.scene.empty()) options.scene = (config_directory() / "scenes/cube/cube.yaml").string();
  const OutputRule rule(options.force);
  rule.require_figures("--json", options.json);
  rule.require_figures_folder("--out", options.out, "soak.json", "soak");
  const Scene scene = read_scene(options.scene);
  if (!scene.trajectory) throw UsageError(options.scene + ": has no trajectory to move along");
  options.client.device_id = options.attach ? options.client.device_id : scene.device.id;
  const fs::path scratch = fs::temp_directory_path() / ("haptic-soak-" + std::to_string(getpid()));
  fs::create_directories(scratch);
  const std::unique_ptr<const fs::path, void (*)(const fs::path*)> gone(&scratch, [](const fs::path* p) {
    std::error_code e;
    fs::remove_all(*p, e);
  });
  if (!options.out.empty()) fs::create_directories(options.out);

  for (const char* tool : {"cyclictest", "ddsperf"})
    if (!is_installed(tool))
      std::fprintf(stderr, "haptic: %s is not installed (tools/setup): no ratio against it\n", tool);
  Soak run(options, scene, scratch);
  run.run();

  std::vector<SoakCheck> checks;
  Json json = soak_report(run.record(), checks);
  const std::string verdict = verdict_of(checks);
  Json list = Json::array();
  for (const SoakCheck& c : checks)
    list.push_back({{"what", c.what},
                    {"value", c.known ? Json(rounded(c.value, 4)) : Json()},
                    {"limit", rounded(c.limit, 4)},
                    {"kept", c.kept()}});
  json["checks"] = list;
  json["verdict"] = verdict;
  if (!options.json.empty()) write_json(options.json, json);
  print_soak(json, checks);
  if (!options.out.empty()) {
    const std::string file = (fs::path(options.out) / "soak.json").string();
    write_json(file, json);
    Child plot({.command = {"/usr/bin/python3", script_file("plot_soak.py").string(), file,
                            (fs::path(options.out) / "soak.png").string()},
                .output = (scratch / "plot.txt").string()});
    if (plot.wait(60) != 0)
      throw std::runtime_error("the histograms could not be drawn: " + text_of(scratch / "plot.txt"));
  }
  std::printf("verdict: %s\n", verdict.c_str());
  return verdict == "pass" ? 0 : 1;
}

Command add_soak(CLI::App& application) {
  auto options = std::make_shared<SoakOptions>();
  CLI::App* app = application.add_subcommand(
      "soak",
      "Runs daemon and client for long and compares them with cyclictest and ddsperf in the same minutes.");
  app->add_option("--duration", options->duration, "of all slices together [s]")
      ->check(CLI::Range(6.0, 86400.0))
      ->capture_default_str();
  app->add_option("--load", options->load, "keep every core busy for this share of the time [%]")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  app->add_option("--scene", options->scene, "default: the cube")->type_name("SCENE.yaml");
  app->add_option("--mode", options->mode, "of the daemon; both: one of each, in turns")
      ->check(CLI::IsMember({"both", "tick", "event"}))
      ->capture_default_str();
  app->add_option("--json", options->json, "write the figures to this file")->type_name("FILE");
  add_force_option(*app, options->force);
  app->add_option("--out", options->out, "write soak.json and the histograms, soak.png, here")
      ->type_name("DIR");
  app->add_flag("--attach", options->attach,
                "soak the daemon that runs in --domain; --mode event says that it is in that mode");
  app->add_option("--domain", options->client.domain, "DDS domain; this one and the next two are used")
      ->check(CLI::Range(0u, 228u))
      ->capture_default_str();
  app->add_option("--device-id", options->client.device_id, "with --attach: the device to be")
      ->capture_default_str();
  app->footer(
      "Example: haptic soak --duration 60 --load 70 --json soak.json --out build/soak\n"
      "Exit code 0 only if every bound in the table was kept.");
  return {app, [options] { return soak(*options); }};
}

}  // namespace hapticd
