// hapticd SCENE.yaml: reads, checks, starts, serves until a signal, stops, reports.
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <new>

#include <sys/syscall.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "physics/compliance/blas_threads.h"
#include "server/app/daemon.h"
#include "server/app/notify.h"
#include "server/app/reload.h"
#include "server/app/service.h"
#include "server/dds/dds.h"
#include "server/dds/key_dates.h"
#include "server/dds/network.h"
#include "server/files/input_error.h"
#include "server/files/output_file.h"
#include "server/files/usage.h"
#include "server/observe/dds_log.h"
#include "server/observe/log.h"
#include "server/observe/metrics_server.h"
#include "server/os/crash_report.h"
#include "server/os/realtime.h"
#include "server/os/room.h"
#include "server/plan/plan.h"
#include "server/record/bag_writer.h"
#include "server/scene/scene_describe.h"
#include "server/scene/scene_reader.h"
#include "server/scene/scene_world.h"

namespace {

using namespace hapticd;

constexpr int input_error = 2, run_error = 1;

struct Arguments {
  std::string scene;
  bool check = false;
  std::string mode;
  bool test_hooks = false;
  double duration = 0;
  std::uint32_t domain = 0;
  std::string device, record, capture, schedule, json, secure, log, metrics;
  std::uint64_t capture_every = 0;
  bool force = false, open_network = false, no_haptics = false, no_tank = false;
  std::vector<std::string> also;
  std::vector<std::uint32_t> edge_devices;
  std::optional<std::uint32_t> edge_domain;
  Network network;
};

void define(CLI::App& app, Arguments& a) {
  app.footer(
      "Examples:\n  hapticd config/scenes/cataract/cataract.yaml --domain 7 --json run.json\n"
      "  hapticd config/scenes/two_hands/two_hands.yaml --edge-devices 1 --edge-domain 1    # the second "
      "hand is a mentor's, elsewhere");
  app.set_version_flag("--version", std::string("hapticd ") + HAPTICD_VERSION);
  app.add_option("scene", a.scene, "The scene, a YAML file (config/README.md tells its keys)")->required();
  app.add_flag("--check", a.check,
               "Read everything, try and print the plan, start nothing; exit code 2 on an error");
  app.add_option("--duration", a.duration, "Stop by itself after so many seconds; 0: run until a signal")
      ->check(not_negative);
  app.add_option("--domain", a.domain, "DDS domain")->check(CLI::Range(0, 230))->capture_default_str();
  app.add_option("--device", a.device,
                 "Device file or name that replaces the first instrument's (limits only)");
  app.add_option(
      "--also", a.also,
      "One more device, as the scene's first but with tissue, id and limits of its own; may be repeated");
  app.add_option(
         "--record", a.record,
         "Write every haptic tick to this directory, a rosbag2 recording; or to a CSV file: FILE.csv. Of "
         "several instruments the first has this name, the others with their own: FILE.NAME.csv")
      ->type_name("DIR|FILE.csv");
  CLI::Option* capture = app.add_option(
      "--capture", a.capture,
      "Write contact problems whose solve ended at a cap into this directory (haptic chart lcp --from)");
  app.add_option("--capture-every", a.capture_every, "... and every N-th one besides")->needs(capture);
  app.add_option(
         "--schedule", a.schedule,
         "Write to this file what each tick and step was given: haptic replay --offline --schedule FILE "
         "makes the same forces of it")
      ->type_name("FILE");
  app.add_option("--mode", a.mode,
                 "Instead of the scene's haptic.mode: a force each millisecond (tick), or for "
                 "each device state (event)")
      ->check(CLI::IsMember({"tick", "event"}));
  app.add_option(
      "--json", a.json,
      "Write the run's figures to this file at the end, and at each SIGUSR1; with --check the plan");
  app.add_flag(
      "--force", a.force,
      "Write over files of --record FILE.csv, --capture, --schedule and --json that are there already");
  app.add_option("--log", a.log,
                 "Lines for a person (human) or a program (json); default: human on a terminal")
      ->check(CLI::IsMember({"human", "json"}));
  app.add_option("--metrics", a.metrics,
                 "Answer Prometheus on this loopback port, at /metrics; also 127.0.0.1:PORT, [::1]:PORT")
      ->type_name("PORT")
      ->check(metrics_address_fault);
  app.add_flag(
      "--test-hooks", a.test_hooks,
      "For tests alone: SIGRTMIN with a value holds the simulation so many ms, SIGRTMIN+1 makes its next "
      "problem not finite, SIGUSR2 holds the thread that it is sent to for 1.5 s");
  app.add_option("--secure", a.secure,
                 "Admit nobody without a certificate: DIR from config/dds/security/make_keys.sh")
      ->type_name("DIR");
  app.add_flag(
      "--open-network", a.open_network,
      "Serve an interface that the DDS profile names without --secure: whoever is on that network may "
      "move the device, read everything, and end this process with a packet");
}

void define_network(CLI::App& app, Arguments& a) {
  CLI::Option* no_haptics = app.add_flag("--no-haptics", a.no_haptics,
                                         "The simulation alone: devices and forces are at another process, "
                                         "mostly another machine (haptic edge)");
  for (const char* name : {"--record", "--capture", "--schedule", "--also", "--device"})
    no_haptics->excludes(app.get_option(name));
  CLI::Option* at_edge = app.add_option("--edge-devices", a.edge_devices,
                                        "Ids of instruments' devices that `haptic edge SCENE --devices "
                                        "ID,ID` answers on another machine, "
                                        "as a mentor's; the others are answered here")
                             ->delimiter(',')
                             ->excludes(no_haptics)
                             ->type_name("ID");
  for (const char* name : {"--schedule", "--also"}) at_edge->excludes(app.get_option(name));
  app.add_option("--edge-domain", a.edge_domain,
                 "With --edge-devices: DDS domain of that edge, in the network of --interface; devices and "
                 "clients in --domain are then on this machine alone")
      ->check(CLI::Range(0, 230))
      ->needs(at_edge);
  app.add_flag("--no-tank", a.no_tank,
               "With --edge-devices: do not hold back what a late pose of the other hand would give this one")
      ->needs(at_edge);
  CLI::Option* interface =
      app.add_option(
             "--interface", a.network.interface,
             "Serve this network interface, by name or address, instead of this machine alone; with --secure "
             "or --open-network")
          ->check(network_name_fault)
          ->type_name("NAME");
  app.add_option("--peers", a.network.peers,
                 "Machines to look for there: HOST,HOST; default: whoever hears the network's multicast")
      ->delimiter(',')
      ->check(network_name_fault)
      ->needs(interface)
      ->type_name("HOST");
  app.add_option("--station", a.network.station,
                 "This daemon's station: it hears and is heard by programs of the same station alone")
      ->check(network_name_fault)
      ->type_name("NAME");
}

// A thread that a library made before main would not block what this one waits for (OpenBLAS's have ended:
// blas_threads.h). What reaches it while this one is busy would end the process by default: it is handed
// over. The kernel lets no thread send another what says that kill or the kernel sent it: so as if queued,
// and a lost terminal as SIGTERM.
pid_t waiting_thread = 0;
void hand_over(int number, siginfo_t* info, void*) {
  const int before = errno;
  siginfo_t handed = *info;
  if (handed.si_code == SI_KERNEL && number == SIGHUP) number = handed.si_signo = SIGTERM;
  if (handed.si_code >= 0) handed.si_code = SI_QUEUE;
  syscall(SYS_rt_tgsigqueueinfo, getpid(), waiting_thread, number, &handed);
  errno = before;
}

// Blocks the signals that the daemon answers, in this thread and all it makes.
sigset_t block_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGUSR1);
  sigaddset(&set, SIGHUP);
  sigaddset(&set, SIGRTMIN);
  sigaddset(&set, SIGRTMIN + 1);
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  waiting_thread = gettid();
  struct sigaction action {};
  action.sa_sigaction = hand_over;
  action.sa_flags = SA_SIGINFO | SA_RESTART;
  for (int number = 1; number <= SIGRTMAX; ++number)
    if (sigismember(&set, number) == 1) sigaction(number, &action, nullptr);
  // A file at its size limit is a full disk: the recording ends, the daemon does not. Nor where nobody reads
  // its log.
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  return set;
}

// Whole or not at all: who asked by SIGUSR1 waits for the file to appear.
void write_json(const std::string& file, const auto& json) { write_file(file, json.dump(2) + '\n'); }

void check_outputs(const Arguments& a) {
  const OutputRule rule(a.force);
  rule.require_figures("--json", a.json);
  std::filesystem::path(a.record).extension() == ".csv" ? rule.require_new("--record", a.record)
                                                        : rule.require_folder("--record", a.record);
  rule.require_new("--schedule", a.schedule);
  rule.require_folder_without("--capture", a.capture, ".contact");
}

// Each recording of several is refused before any is begun.
void check_recordings(const Arguments& a, const Scene& scene) {
  if (a.record.empty() || scene.instruments.size() < 2) return;
  const OutputRule rule(a.force);
  for (const std::filesystem::path& file : recordings_of(a.record, scene))
    file.extension() == ".csv" ? rule.require_new("--record", file) : require_no_bag(file);
}

void write_figures(const Daemon& daemon, const std::string& file) { write_json(file, daemon.summary()); }

// A test hook: the thread that gets the signal stands.
void stand_still(int) {
  const timespec time{1, 500'000'000};
  nanosleep(&time, nullptr);
}

// OpenBLAS asks for its buffers for ever where there are none, at the process's end too: so this ends at
// once.
void require_start() {
  try {
    require_address_space(std::size_t{512} << 20);
  } catch (const std::exception& e) {
    std::cerr << "hapticd: " << e.what() << std::endl;
    std::_Exit(run_error);
  }
}

// What a scene takes beyond that, as measured (server/MEASURED.md#memory): the kernel kills without a word.
void require_room_for(const Scene& scene, const Arguments& a) {
  const bool locks = !a.check && may_lock_memory();
  const int worlds = 1 + static_cast<int>(scene.more_devices.size());
  const int devices = static_cast<int>(scene.instruments.size()) + worlds - 1;
  const std::int64_t base = locks ? 360'000'000 : 85'000'000;
  require_memory(base + worlds * memory_of(scene),
                 locks ? "; without the right to lock memory (ulimit -l 64) " +
                             std::to_string((85'000'000 + worlds * memory_of(scene)) / 1'000'000) +
                             " MB are enough"
                       : "");
  if (a.check) return;
  require_threads(12 + 3 * worlds + 2 * devices);
  require_descriptors(24 + 4 * devices + (a.metrics.empty() ? 0 : 20));
}

// What was refused, and what that means.
void announce(const std::vector<Grant>& grants) {
  bool degraded = false;
  for (const Grant& g : grants) {
    if (g.granted) continue;
    log(LogLevel::warning, "not_granted", "not granted: " + g.what + ": " + g.detail,
        {{"what", g.what}, {"detail", g.detail}});
    degraded = true;
  }
  if (degraded)
    log(LogLevel::warning, "degraded", "degraded: everything works, but other programs can make forces late");
}

void announce(const Plan& plan, bool human) {
  if (human)
    std::cout << describe(plan) << std::flush;
  else
    log(LogLevel::info, "plan", "the plan", to_json(plan));
}

int check(const Arguments& a, const Scene& scene) {
  const Plan plan = make_plan(scene);
  std::cout << describe(plan.scene) << describe(plan);
  if (!a.json.empty()) write_json(a.json, to_json(plan));
  return 0;
}

bool logs_for_a_person(const Arguments& a) {
  return a.log.empty() ? a.check || isatty(STDERR_FILENO) : a.log == "human";
}

std::vector<std::uint32_t> edge_devices(const Arguments& a, const Scene& scene) {
  if (!a.no_haptics) return a.edge_devices;
  std::vector<std::uint32_t> all;
  for (const SceneInstrument& held : scene.instruments) all.push_back(held.device.id);
  for (const DeviceSettings& device : scene.more_devices) all.push_back(device.id);
  return all;
}

int run(const Arguments& a) {
  const Notifier notifier;
  const bool human = logs_for_a_person(a);
  set_log_format(human ? LogFormat::human : LogFormat::json);
  require_start();
  use_one_blas_thread();
  check_outputs(a);
  Scene scene = read_scene(a.scene, a.device);
  for (const std::string& device : a.also) add_device(scene, device);
  require_instruments_of(scene, a.edge_devices, "--edge-devices");
  if (!a.edge_devices.empty() && !a.network.interface.empty() && !a.edge_domain)
    throw InputError(
        scene.file, 0, "--interface",
        "with --edge-devices the devices here stay on this machine: the "
        "edge needs a domain of its own (--edge-domain N, as haptic edge --simulation-domain N)");
  if (a.edge_domain == a.domain)
    throw InputError(scene.file, 0, "--edge-domain", "is --domain: leave it out, or give the edge another");
  check_recordings(a, scene);
  require_room_for(scene, a);
  set_log_level(log_level(scene.log_level).value_or(LogLevel::info));
  std::optional<Security> security;
  use_network(a.network);
  if (a.open_network) open_network();
  if (!a.secure.empty()) security = security_files(a.secure, "daemon");
  // Large blocks come from the heap from here on, as in the run: their page faults would be half a step's
  // cost.
  keep_malloc_pages();
  if (a.check) return check(a, scene);
  Reloader reloader(scene, a.device, a.also);
  if (scene.plans) {
    Plan plan = make_plan(scene);
    announce(plan, human);
    scene = std::move(plan.scene);
  }
  const sigset_t signals = block_signals();
  if (a.test_hooks) std::signal(SIGUSR2, stand_still);
  const LoopMode mode = a.mode.empty()      ? scene.haptic_mode
                        : a.mode == "event" ? LoopMode::event
                                            : LoopMode::tick;
  if (mode == LoopMode::event && !a.edge_devices.empty())
    throw InputError(scene.file, 0, "haptic.mode",
                     "event: beside an edge's device the loop ticks (--mode tick)");
  const auto path = [](const std::string& text) {
    return text.empty() ? std::nullopt : std::optional<std::filesystem::path>(text);
  };
  take_dds_log();
  Daemon daemon(scene, {a.domain, mode, path(a.record), path(a.capture), a.capture_every, security,
                        path(a.schedule), edge_devices(a, scene), !a.no_tank, a.edge_domain});
  daemon.start();
  announce(daemon.grants());
  std::optional<MetricsServer> metrics;
  if (!a.metrics.empty()) {
    metrics.emplace(a.metrics, [&daemon] { return daemon.metrics(); });
    const std::string where = std::to_string(metrics->port());
    log(LogLevel::info, "metrics", "metrics on port " + where, {{"port", metrics->port()}});
  }
  const std::string ready = ready_text(a.domain, security.has_value());
  log(LogLevel::info, "ready", ready,
      {{"domain", a.domain}, {"scene", scene.name}, {"version", HAPTICD_VERSION}});
  notifier.ready(ready);

  ServiceOptions service{.duration = a.duration, .test_hooks = a.test_hooks, .figures = {}};
  if (security) service.key_days = days_left(*security);
  if (!a.json.empty()) service.figures = [&] { write_figures(daemon, a.json); };
  Service(daemon, reloader, notifier, signals, service).run();
  notifier.stopping();
  log(LogLevel::info, "stopping", "stopping");
  daemon.stop();
  write_whole_dds_log();
  if (!a.json.empty()) write_figures(daemon, a.json);
  if (daemon.failed()) throw std::runtime_error("the simulation stopped: " + daemon.failure());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  report_crashes();
  CLI::App app("A haptic server for soft tissue that is being cut.", "hapticd");
  Arguments arguments;
  define(app, arguments);
  define_network(app, arguments);
  try {
    app.parse(argc, argv);
    check_numbers(app);
  } catch (const CLI::ParseError& e) {
    const std::string fault = e.get_exit_code() == 0 ? "" : usage_fault(app, argc, argv);
    if (fault.empty()) return app.exit(e) == 0 ? 0 : input_error;
    std::cerr << "hapticd: " << fault << "\nRun with --help for more information.\n";
    return input_error;
  }
  try {
    return run(arguments);
  } catch (const InputError& e) {
    log(LogLevel::error, "input", e.what(),
        {{"file", e.file().string()}, {"line", e.line()}, {"key", e.key()}});
    return input_error;
  } catch (const std::bad_alloc&) {
    std::cerr << "hapticd: not enough memory for this scene\n";
    return run_error;
  } catch (const std::exception& e) {
    write_whole_dds_log();
    log(LogLevel::error, "failed", e.what());
    return run_error;
  }
}
