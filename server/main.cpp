// hapticd SCENE.yaml: reads, checks, starts, waits for a signal, stops, reports.
#include <csignal>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <iostream>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "server/daemon.h"
#include "server/input_error.h"
#include "server/scene_describe.h"
#include "server/scene_reader.h"

namespace {

using namespace hapticd;

constexpr int input_error = 2, run_error = 1;

struct Arguments {
  std::string scene;
  bool check = false;
  double duration = 0;
  std::uint32_t domain = 0;
  std::string device, record, json, secure;
};

void define(CLI::App& app, Arguments& a) {
  app.footer("Example:\n  hapticd config/scenes/cataract/cataract.yaml --domain 7 --json run.json");
  app.set_version_flag("--version", std::string("hapticd ") + HAPTICD_VERSION);
  app.add_option("scene", a.scene, "The scene, a YAML file (config/README.md tells its keys)")->required();
  app.add_flag("--check", a.check, "Read everything, print the plan, start nothing; exit code 2 on an error");
  app.add_option("--duration", a.duration, "Stop by itself after so many seconds; 0: run until a signal")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--domain", a.domain, "DDS domain")->check(CLI::Range(0, 230))->capture_default_str();
  app.add_option("--device", a.device, "Device file or name that replaces the scene's (limits only)");
  app.add_option("--record", a.record, "Write every haptic tick to this CSV file");
  app.add_option("--secure", a.secure,
                 "Admit nobody without a certificate: DIR from config/dds/security/make_keys.sh")
      ->type_name("DIR");
  app.add_option("--json", a.json, "Write the run's figures to this file at the end");
}

// Blocks the signals that end the daemon in this thread and all it makes.
sigset_t block_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  return set;
}

// Waits for a signal, the end of `duration`, or a failure of the daemon.
void wait_for_end(const sigset_t& signals, double duration, const Daemon& daemon) {
  const timespec slice{0, 100'000'000};
  const std::int64_t end = duration > 0 ? monotonic_ns() + std::llround(1e9 * duration) : INT64_MAX;
  while (monotonic_ns() < end && !daemon.failed())
    if (sigtimedwait(&signals, nullptr, &slice) > 0) return;
}

int run(const Arguments& a) {
  const Scene scene = read_scene(a.scene, a.device);
  std::optional<Security> security;
  if (!a.secure.empty()) security = security_files(a.secure, "daemon");
  if (a.check) {
    std::cout << describe(scene);
    return 0;
  }
  const sigset_t signals = block_signals();
  Daemon daemon(
      scene,
      {a.domain, a.record.empty() ? std::nullopt : std::optional<std::filesystem::path>(a.record), security});
  daemon.start();
  for (const Grant& g : daemon.grants())
    if (!g.granted) std::cerr << "hapticd: not granted: " << g.what << ": " << g.detail << '\n';
  std::cout << "hapticd: ready, domain " << a.domain << (security ? ", secured" : "") << std::endl;

  wait_for_end(signals, a.duration, daemon);
  daemon.stop();
  if (!a.json.empty()) {
    std::ofstream out(a.json);
    out << daemon.summary().dump(2) << '\n';
    if (!out) throw std::runtime_error("cannot write " + a.json);
  }
  if (daemon.failed()) throw std::runtime_error("the simulation stopped: " + daemon.failure());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("A haptic server for soft tissue that is being cut.", "hapticd");
  Arguments arguments;
  define(app, arguments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    const int code = app.exit(e);
    return code == 0 ? 0 : input_error;
  }
  try {
    return run(arguments);
  } catch (const InputError& e) {
    std::cerr << "hapticd: " << e.what() << '\n';
    return input_error;
  } catch (const std::exception& e) {
    std::cerr << "hapticd: " << e.what() << '\n';
    return run_error;
  }
}
