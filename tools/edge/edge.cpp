// haptic edge: the haptic half of a daemon, beside the devices; the simulation is another process, mostly
// another machine.
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>

#include <nlohmann/json.hpp>

#include "haptic/clock.h"
#include "server/app/edge_session.h"
#include "server/dds/network.h"
#include "server/files/input_error.h"
#include "server/files/output_file.h"
#include "server/files/usage.h"
#include "server/observe/incidents.h"
#include "server/observe/log.h"
#include "server/record/bag_writer.h"
#include "server/scene/scene_reader.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/report.h"
#include "tools/edge/edge_trial.h"

namespace hapticd {
namespace {

constexpr auto relaxed = std::memory_order_relaxed;

struct EdgeCommand {
  std::string scene, mode, record, json, secure, log;
  std::uint32_t domain = 0, simulation_domain = 0;
  double duration = 0, seconds = 0, late_ms = 0;
  bool force = false, tries = false, bare = false;
  std::vector<std::uint32_t> devices;
};

LoopCounters counters_of(const EdgeSession& session, int device, std::uint32_t id) {
  const LoopStatistics& h = session.statistics(device);
  return {.device_id = id,
          .status = h.status.load(relaxed) | (h.run.load(relaxed) == 0 ? std::uint32_t{status_disarmed} : 0u),
          .deadline_misses = h.deadline_misses.load(relaxed),
          .missed = h.missed.load(relaxed),
          .refused = h.refused.load(relaxed),
          .conflicts = h.conflicts.load(relaxed),
          .solver_caps = h.solver_caps.load(relaxed)};
}

int try_scene(const EdgeCommand& o, const Scene& scene) {
  const EdgeTrial t = try_edge(scene, o.seconds);
  nlohmann::ordered_json json = {{"command", "edge --try"},
                                 {"scene", scene.file.string()},
                                 {"seconds", rounded(t.seconds, 3)},
                                 {"problems", t.problems},
                                 {"problems_refused", t.refused},
                                 {"bandwidth_mbit", rounded(t.mbit_steps, 3)},
                                 {"bandwidth_with_refreshes_mbit", rounded(t.mbit, 3)},
                                 {"bandwidth_peak_second_mbit", rounded(t.mbit_peak, 3)},
                                 {"float_rms_rel", t.force_rms_rel},
                                 {"float_max_rel", t.force_max_rel},
                                 {"force_peak_n", t.force_peak},
                                 {"patches", nlohmann::ordered_json::array()},
                                 {"links", nlohmann::ordered_json::array()}};
  Table table{
      {"scene", scene.name + ", " + fixed(t.seconds, 1) + " s, " + std::to_string(t.problems) + " problems"},
      {"one problem a step", fixed(t.mbit_steps, 1) + " Mbit/s at " + fixed(t.rate, 0) + " Hz"},
      {"with those after removals",
       fixed(t.mbit, 1) + " Mbit/s; " + fixed(t.mbit_peak, 1) + " in the second that carries most"}};
  char text[64];
  std::snprintf(text, sizeof text, "%.1e RMS, %.1e at most, of the peak", t.force_rms_rel, t.force_max_rel);
  table.emplace_back("force error of what is rounded", text);
  for (const PatchTraffic& p : t.patches) {
    json["patches"].push_back({{"nodes_from", p.nodes_from},
                               {"nodes_to", p.nodes_to},
                               {"problems", p.problems},
                               {"mean_bytes", rounded(p.mean_bytes, 0)},
                               {"mbit_at_rate", rounded(p.mbit_at_rate, 3)},
                               {"samples_max", p.samples_max}});
    table.emplace_back(
        "patch of " + std::to_string(p.nodes_from) + " to " + std::to_string(p.nodes_to) + " nodes",
        fixed(1e-3 * p.mean_bytes, 1) + " kB, " + fixed(p.mbit_at_rate, 1) + " Mbit/s at " +
            fixed(t.rate, 0) + " Hz, " + std::to_string(p.problems) + " problems");
  }
  for (const LinkCost& c : t.links) {
    const LinkTrouble& l = c.link;
    json["links"].push_back({{"delay_ms", rounded(1e3 * l.delay, 3)},
                             {"jitter_ms", rounded(1e3 * l.jitter, 3)},
                             {"loss", l.loss},
                             {"force_rms_rel", c.force_rms_rel},
                             {"force_tank_rms_rel", c.tanked_rms_rel}});
    table.emplace_back("force over a link of " + fixed(1e3 * l.delay, 0) + " ± " + fixed(1e3 * l.jitter, 0) +
                           " ms, loss " + fixed(100 * l.loss, 0) + " %",
                       "differs by " + fixed(100 * c.force_rms_rel, 2) + " % RMS of the peak, " +
                           fixed(100 * c.tanked_rms_rel, 2) + " % with the tank");
  }
  if (!o.json.empty()) write_json(o.json, json);
  print(table);
  return t.refused == 0 ? 0 : 1;
}

// Until a signal, or for `duration`.
void serve(const EdgeSession& session, const Scene& scene, double duration) {
  Incidents incidents;
  constexpr std::int64_t look_ns = 100'000'000;
  const std::int64_t end = duration > 0 ? monotonic_ns() + std::llround(1e9 * duration) : INT64_MAX;
  while (monotonic_ns() < end && !interrupted()) {
    sleep_until(std::min(monotonic_ns() + look_ns, end));
    for (std::size_t i = 0; i < scene.instruments.size(); ++i) {
      const LoopCounters counters = counters_of(session, static_cast<int>(i), scene.instruments[i].device.id);
      for (const Incident& of : incidents.look(monotonic_ns(), counters))
        log(of.level, of.event, of.message, of.fields);
    }
  }
}

void check_outputs(const EdgeCommand& o, const Scene& scene) {
  const OutputRule rule(o.force);
  rule.require_figures("--json", o.json);
  if (o.record.empty()) return;
  for (const std::filesystem::path& file : recordings_of(o.record, scene))
    file.extension() == ".csv" ? rule.require_new("--record", file) : require_no_bag(file);
}

int run(const EdgeCommand& o) {
  if (!process_network().interface.empty() && o.domain == o.simulation_domain && !o.tries)
    throw UsageError(
        "--interface: devices stay on this machine, so the simulation needs a domain of its own: "
        "--simulation-domain N, as hapticd --domain N");
  const bool human = o.log.empty() ? isatty(STDERR_FILENO) != 0 : o.log == "human";
  set_log_format(human ? LogFormat::human : LogFormat::json);
  const Scene scene = read_scene(o.scene);
  require_instruments_of(scene, o.devices, "--devices");
  check_outputs(o, scene);
  if (o.tries) return try_scene(o, scene);
  EdgeOptions options{
      .domain = o.domain, .simulation_domain = o.simulation_domain, .record = {}, .security = {}};
  options.mode = o.mode.empty() ? scene.haptic_mode : o.mode == "event" ? LoopMode::event : LoopMode::tick;
  if (options.mode == LoopMode::event && !o.devices.empty())
    throw InputError(scene.file, 0, "haptic.mode",
                     "event: beside a hand elsewhere the loop ticks (--mode tick)");
  options.devices = o.devices;
  options.tank = !o.bare;
  options.late = 1e-3 * o.late_ms;
  if (!o.record.empty()) options.record = o.record;
  if (!o.secure.empty()) options.security = security_files(o.secure, "edge");
  EdgeSession session(scene, options);
  session.start();
  for (const Grant& g : session.grants())
    if (!g.granted) log(LogLevel::warning, "not_granted", "not granted: " + g.what + ": " + g.detail);
  log(LogLevel::info, "ready",
      "ready, domain " + std::to_string(o.domain) + ", simulation in domain " +
          std::to_string(o.simulation_domain),
      {{"domain", o.domain}, {"simulation_domain", o.simulation_domain}, {"scene", scene.name}});
  serve(session, scene, o.duration);
  session.stop();
  if (!o.json.empty()) {
    nlohmann::ordered_json json = {{"command", "edge"}, {"scene", scene.file.string()}};
    const nlohmann::json summary = session.summary();
    for (const auto& [key, value] : summary.items()) json[key] = value;
    write_json(o.json, json);
  }
  return 0;
}

}  // namespace

Command add_edge(CLI::App& application) {
  auto o = std::make_shared<EdgeCommand>();
  CLI::App* app = application.add_subcommand(
      "edge",
      "The haptic half of a daemon beside the devices; the simulation is `hapticd --no-haptics`, elsewhere.");
  app->add_option("scene", o->scene, "the scene, the same file as the simulation's")->required();
  app->add_option("--domain", o->domain, "DDS domain of the devices, on this machine")
      ->check(CLI::Range(0, 230))
      ->capture_default_str();
  app->add_option("--simulation-domain", o->simulation_domain,
                  "DDS domain of the simulation: in the network of --interface, or on this machine too")
      ->check(CLI::Range(0, 230))
      ->capture_default_str();
  app->add_option(
         "--devices", o->devices,
         "answer the instruments with these device ids alone, as a mentor's; the others' are answered by "
         "`hapticd SCENE --edge-devices ID,ID`, with the same ids")
      ->delimiter(',')
      ->type_name("ID");
  app->add_option("--duration", o->duration, "end after so many seconds; 0: run until a signal")
      ->check(not_negative);
  app->add_option("--mode", o->mode, "instead of the scene's haptic.mode")
      ->check(CLI::IsMember({"tick", "event"}));
  CLI::Option* bare =
      app->add_flag("--no-tank", o->bare,
                    "do not hold back what a late problem would give the hand beyond what the hand "
                    "put in");
  app->add_option(
         "--late", o->late_ms,
         "ms: problems are felt until they are so old, instead of 60, and lost 140 ms later: for links of "
         "20 ms and more")
      ->check(CLI::Range(60.0, 500.0))
      ->excludes(bare);
  app->add_option("--record", o->record, "write every tick to this rosbag2 directory, or CSV: FILE.csv")
      ->type_name("DIR|FILE.csv");
  app->add_option("--json", o->json, "write the figures to this file")->type_name("FILE");
  add_force_option(*app, o->force);
  app->add_option("--log", o->log, "lines for a person or a program; default: human on a terminal")
      ->check(CLI::IsMember({"human", "json"}));
  app->add_option("--secure", o->secure, "admit nobody without a certificate: DIR with the role `edge`")
      ->type_name("DIR");
  CLI::Option* tries = app->add_flag("--try", o->tries,
                                     "serve nobody: measure along the scene's trajectory what its problems "
                                     "take of a network, and what their rounding "
                                     "costs in force");
  app->add_option("--seconds", o->seconds, "of the trajectory, for --try; 0: all")
      ->check(not_negative)
      ->needs(tries);
  app->footer(
      "Examples:\n"
      "  hapticd cube.yaml --no-haptics --domain 1 & haptic edge cube.yaml --simulation-domain 1     # one "
      "machine\n"
      "  haptic --interface eth0 --peers 10.0.0.1 --open-network edge cube.yaml --simulation-domain 1\n"
      "                      # on 10.0.0.1: hapticd cube.yaml --no-haptics --domain 1 --interface eth0 "
      "--peers 10.0.0.2 "
      "--open-network\n"
      "  hapticd two_hands.yaml --edge-devices 1 --edge-domain 1 & haptic edge two_hands.yaml --devices 1 "
      "--simulation-domain 1    # a mentor's hand\n"
      "  haptic edge cube.yaml --try");
  return {app, [o] { return run(*o); }};
}

}  // namespace hapticd
