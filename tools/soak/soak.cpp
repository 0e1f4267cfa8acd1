#include "tools/soak/soak.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <set>
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
constexpr int longest = 10;  // times the duration, until decided

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
        core_(process_cores().back()),
        client_core_(process_cores().front()) {
    has_cyclictest_ = is_installed("cyclictest") && realtime_allowed();  // it ends without that right
    has_ddsperf_ = is_installed("ddsperf");
    tool_domain_ = options.client.domain + 2;
    add_hands(scene);
    SoakRecord record;
    record.scene = options.scene;
    record.mode = options.attach ? "attached" : options.mode;
    record.duration = options.duration;
    record.load = options.load;
    record.own = !options.attach;
    records_.assign(tick_hands_.size(), record);
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
    for (int c = 0; !interrupted() && (c < cycles || (c < longest * cycles && !decided())); ++c) {
      const std::vector<SoakFigures> parts = cycle(seconds, [&](const char* what, double done) {
        progress.show(std::min(1.0, (c + done) / cycles), what);
      });
      const auto minute = static_cast<std::size_t>((c + 0.5) * seconds / 60);
      for (std::size_t i = 0; i < parts.size(); ++i) {
        SoakRecord& record = records_[i];
        if (c == 0) record.first_rss_mb = parts[i].rss_mb;
        record.all.merge(parts[i]);
        record.minutes.resize(minute + 1);
        record.minutes.back().merge(parts[i]);
        record.duration = (c + 1) * seconds;
      }
    }
    if (interrupted()) throw std::runtime_error("interrupted");
    const CpuTimes after = cpu_times();
    const double total = after.busy + after.idle + after.steal - before.busy - before.idle - before.steal;
    const std::vector<Neighbour> neighbours = realtime_neighbours(core_, own_processes());
    for (SoakRecord& record : records_) {
      record.neighbours = neighbours;
      record.busy = (after.busy - before.busy) / total;
      record.steal = (after.steal - before.steal) / total;
      for (const SoakDaemon* server : {tick_.get(), event_.get()})
        if (server) record.summaries.push_back(server->last());
    }
  }

  // One of each hand.
  const std::vector<SoakRecord>& records() const { return records_; }
  std::uint32_t device_id(std::size_t i) const { return tick_hands_[i].device_id; }

 private:
  // Each hand begins elsewhere in its motion: two that move alike would hide what one does to the other.
  void add_hands(const Scene& scene) {
    for (int i = 0; i < options_.hands; ++i) {
      const SceneInstrument& held = scene.instruments[static_cast<std::size_t>(i)];
      const Trajectory& motion =
          trajectories_.emplace_back(read_trajectory(*held.trajectory, LengthUnit::metre));
      const double begin = i * (motion.end() - motion.begin()) / 3;
      const std::uint32_t id = options_.attach && i == 0 ? options_.client.device_id : held.device.id;
      tick_hands_.push_back({id, sources_.emplace_back(motion, begin)});
      event_hands_.push_back({id, sources_.emplace_back(motion, begin)});
    }
  }

  // Of every hand.
  bool decided() const {
    return !options_.until_decided || std::all_of(records_.begin(), records_.end(),
                                                  [](const SoakRecord& r) { return judge(r, {}).decided(); });
  }
  std::set<pid_t> own_processes() const {
    std::set<pid_t> own;
    for (const SoakDaemon* server : {tick_.get(), event_.get()})
      if (server) own.insert(server->pid());
    return own;
  }

  template <typename Show>
  std::vector<SoakFigures> cycle(double seconds, Show&& show) {
    std::vector<SoakFigures> f(records_.size());
    const double slice = seconds / slices_per_cycle;
    auto progress = [&, n = 0](const char* what) mutable { show(what, double(n++) / slices_per_cycle); };
    for (const bool second : {false, true}) {
      std::vector<SoakFigures> half(records_.size());
      progress("tick");
      add_tick(slice, half);
      progress("cyclictest");
      add_cyclictest(slice, half);
      progress(second ? "ddsperf" : "event");
      if (second)
        add_ddsperf(slice, half);
      else
        add_event(slice, half);
      for (std::size_t i = 0; i < f.size(); ++i) {
        f[i].merge(half[i]);
        records_[i].blocks.add(half[i]);
      }
    }
    for (const SoakDaemon* server : {tick_.get(), event_.get()})
      for (SoakFigures& of : f)
        if (server) of.rss_mb += server->resident_mb();
    return f;
  }

  bool attached(bool to_event) const { return options_.attach && (options_.mode == "event") == to_event; }
  void add_tick(double seconds, std::vector<SoakFigures>& f) {
    if (!tick_ && !attached(false)) return;
    const std::vector<ServerFigures> slice =
        client_slice(options_.client, client_core_, tick_.get(), tick_hands_, seconds);
    for (std::size_t i = 0; i < f.size(); ++i) f[i].tick.merge(slice[i]);
  }
  void add_event(double seconds, std::vector<SoakFigures>& f) {
    if (!event_ && !attached(true)) return;
    const std::vector<ServerFigures> slice =
        client_slice(options_.client, client_core_, event_.get(), event_hands_, seconds);
    for (std::size_t i = 0; i < f.size(); ++i) f[i].event.merge(slice[i]);
  }
  void add_cyclictest(double seconds, std::vector<SoakFigures>& f) {
    if (!has_cyclictest_ || interrupted()) return;
    const Tally slice =
        with_hidden_wakeups(run_cyclictest(seconds, core_, haptic_priority, scratch_.string()));
    for (SoakFigures& of : f) of.cyclictest_us.merge(slice);
  }
  void add_ddsperf(double seconds, std::vector<SoakFigures>& f) {
    if (!has_ddsperf_ || interrupted()) return;
    const PingFigures figures =
        run_ddsperf(seconds, core_, client_core_, static_cast<int>(tool_domain_), scratch_.string());
    for (SoakFigures& of : f) of.ddsperf.merge(figures);
  }

  SoakOptions options_;
  fs::path scratch_;
  Load load_;  // before anything makes threads
  std::deque<Trajectory> trajectories_;
  std::deque<SwingSource> sources_;
  std::vector<SoakHand> tick_hands_, event_hands_;  // each daemon's motion goes on where it was
  // Of the haptic thread, cyclictest and pong; of the client and ping: a round trip within a core costs half
  // as much.
  int core_, client_core_;
  std::uint32_t tool_domain_ = 0;
  bool has_cyclictest_ = false, has_ddsperf_ = false;
  std::unique_ptr<SoakDaemon> tick_, event_;
  std::vector<SoakRecord> records_;  // one of each hand
};

// Of one hand.
Json judged(const SoakRecord& record, SoakVerdict& verdict) {
  Json json = soak_report(record, verdict);
  print_soak(json, verdict, record.neighbours);
  return json;
}

// Of several hands: what one has at the top has each in `devices`; the verdict is the worst, as sure as the
// least sure.
Json judged_each(const Soak& run, const SoakOptions& options, SoakVerdict& all) {
  Json json{{"command", "soak"},
            {"scene", options.scene},
            {"mode", options.attach ? "attached" : options.mode},
            {"hands", options.hands},
            {"duration_s", run.records().front().duration},
            {"load_percent", options.load},
            {"devices", Json::array()}};
  all.confidence = 1;
  for (std::size_t i = 0; i < run.records().size(); ++i) {
    const std::string name = "device " + std::to_string(run.device_id(i));
    std::printf("%s\n", name.c_str());
    SoakVerdict verdict;
    Json device{{"device_id", run.device_id(i)}};
    device.update(judged(run.records()[i], verdict));
    json["devices"].push_back(device);
    for (SoakCheck& c : verdict.checks) c.what = name + ": " + c.what;
    all.checks.insert(all.checks.end(), verdict.checks.begin(), verdict.checks.end());
    all.fit = verdict.fit;
    all.confidence = std::min(*all.confidence, verdict.confidence.value_or(0));
  }
  all.outcome = outcome_of(all.checks, all.fit);
  json["checks"] = to_json(all.checks);
  json["verdict"] = to_text(all.outcome);
  json["confidence"] = rounded(*all.confidence, 3);
  return json;
}

// soak.json, and soak.png or one of each device.
void write_out(const fs::path& folder, const Json& json, const fs::path& scratch) {
  write_json((folder / "soak.json").string(), json);
  const auto draw = [&](const fs::path& figures, const fs::path& picture) {
    Child plot({.command = {"/usr/bin/python3", script_file("plot_soak.py").string(), figures.string(),
                            picture.string()},
                .output = (scratch / "plot.txt").string()});
    if (plot.wait(60) != 0)
      throw std::runtime_error("the histograms could not be drawn: " + text_of(scratch / "plot.txt"));
  };
  if (!json.contains("devices")) return draw(folder / "soak.json", folder / "soak.png");
  for (const Json& device : json.at("devices")) {
    write_json((scratch / "device.json").string(), device);
    draw(scratch / "device.json", folder / ("soak_" + device.at("device_id").dump() + ".png"));
  }
}

void require_hands(const SoakOptions& options, const Scene& scene) {
  if (static_cast<int>(scene.instruments.size()) < options.hands)
    throw UsageError(options.scene + ": has fewer instruments than --hands");
  for (int i = 0; i < options.hands; ++i)
    if (!scene.instruments[static_cast<std::size_t>(i)].trajectory)
      throw UsageError(options.scene + ": has no trajectory to move along" +
                       (i > 0 ? " for each of its instruments" : ""));
}

}  // namespace

int soak(SoakOptions options) {
  if (options.scene.empty())
    options.scene =
        (config_directory() / "scenes/cube" / (options.hands > 1 ? "two_hands.yaml" : "cube.yaml")).string();
  const OutputRule rule(options.force);
  rule.require_figures("--json", options.json);
  rule.require_figures_folder("--out", options.out, "soak.json", "soak");
  const Scene scene = read_scene(options.scene);
  require_hands(options, scene);
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

  SoakVerdict verdict;
  const Json json =
      options.hands > 1 ? judged_each(run, options, verdict) : judged(run.records().front(), verdict);
  if (!options.json.empty()) write_json(options.json, json);
  if (!options.out.empty()) write_out(options.out, json, scratch);
  std::printf("verdict: %s\n", explained(verdict).c_str());
  return verdict.outcome == SoakOutcome::pass ? 0 : 1;
}

Command add_soak(CLI::App& application) {
  auto options = std::make_shared<SoakOptions>();
  CLI::App* app = application.add_subcommand(
      "soak",
      "Runs daemon and client for long and compares them with cyclictest and ddsperf in the same minutes.");
  app->add_option("--duration", options->duration, "of all slices together [s]")
      ->check(CLI::Range(6.0, 86400.0))
      ->capture_default_str();
  app->add_flag("--until-decided", options->until_decided,
                "go on, ten times as long at most, until the verdict is 95 % sure");
  app->add_option("--load", options->load, "keep every core busy for this share of the time [%]")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  app->add_option("--hands", options->hands, "devices of one world, a client and bounds for each")
      ->check(CLI::Range(1, 2))
      ->capture_default_str();
  app->add_option("--scene", options->scene, "default: the cube, for two hands with two instruments")
      ->type_name("SCENE.yaml");
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
      "Verdicts: pass; fail (ours); machine (a bound was broken, but cyclictest alone was 1 ms late in more\n"
      "than 0.05 % of its wake-ups too: this machine cannot hold it). Exit code 0 only for pass.");
  return {app, [options] { return soak(*options); }};
}

}  // namespace hapticd
