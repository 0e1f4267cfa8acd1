// What a station says, without its loops: the daemon's own publishing thread (server/observe/diagnostics.h),
// fed with the figures and forces of a hand that presses and lets go. For fleets larger than a machine has
// cores.
//
//   station_emulator --station NAME [--domain D] [--interface NAME]
//
// Says "ready" when it publishes; until SIGTERM.
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>

#include "haptic/clock.h"
#include "server/dds/network.h"
#include "server/observe/diagnostics.h"

namespace hapticd {
namespace {

constexpr int ticks_per_turn = 20, ticks_per_press = 4000;
volatile std::sig_atomic_t ended = 0;

Scene small_scene(const std::string& station) {
  Scene scene;
  scene.name = "emulated";
  scene.first().device_name = "touch";
  scene.first().device.max_force = 3.3;
  SceneBody body;
  body.name = station.empty() ? "tissue" : station;
  body.mesh.nodes = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  body.mesh.tets = {{0, 1, 2, 3}};
  scene.bodies.push_back(body);
  return scene;
}

// A press of four seconds, less its let-go; stations do not beat together.
double force_at(std::uint64_t tick, std::uint64_t phase) {
  const double x = static_cast<double>((tick + phase) % ticks_per_press) / ticks_per_press;
  return x < 0.6 ? 1.4 * std::pow(std::sin(x / 0.6 * 3.14159265358979), 2) : 0;
}

void publish(const std::string& station, std::uint32_t domain_id) {
  const Domain domain(domain_id, viewer_dds_profile());
  const Participant participant(domain);
  const Scene scene = small_scene(station);
  const std::uint64_t phase = std::hash<std::string>{}(station) % ticks_per_press;
  LoopStatistics statistics;
  Channel<SceneSnapshot> snapshots;
  SpscQueue<ForceRecord> history(8192);
  Diagnostics diagnostics(participant, scene, statistics, snapshots, history, {});
  diagnostics.start();
  std::puts("ready");
  std::fflush(stdout);
  const std::int64_t begun = monotonic_ns();
  ForceRecord record;
  double path = 0;
  for (std::uint64_t tick = 0; ended == 0;) {
    for (int i = 0; i < ticks_per_turn; ++i, ++tick) {
      record.force.sequence = tick;
      record.force.force = {0, 0, force_at(tick, phase)};
      record.force.status = phase % 3 == 0 ? 1u : 0u;  // a third of them at rest
      if (record.force.status != 0) record.force.force.setZero();
      history.push(record);
      statistics.wake.record(2'000 + static_cast<std::int64_t>((tick * 7919 + phase) % 40'000));
      path += 1e-3 * record.force.force.z() * 0.02;
    }
    statistics.run = tick;
    statistics.status = record.force.status;
    SceneSnapshot& s = snapshots.back();
    s.step = tick / ticks_per_turn;
    s.rate_hz = 50;
    s.step_ms = 6 + 2 * record.force.force.z();
    s.operation.time = 1e-3 * static_cast<double>(tick);
    s.operation.hands = {{path, s.operation.time, 0, 0, 1.4}};
    s.operation.bodies = {
        {.name = "tissue", .deformable = true, .volume = 1, .volume_gone = 0.1, .pieces = 1}};
    snapshots.publish();
    const std::int64_t due = begun + 1'000'000 * static_cast<std::int64_t>(tick);
    std::this_thread::sleep_for(std::chrono::nanoseconds(std::max<std::int64_t>(0, due - monotonic_ns())));
  }
}

}  // namespace
}  // namespace hapticd

int main(int argc, char** argv) {
  using namespace hapticd;
  Network network;
  std::uint32_t domain = 0;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string option = argv[i], value = argv[i + 1];
    if (option == "--station") network.station = value;
    if (option == "--interface") network.interface = value;
    if (option == "--domain") domain = static_cast<std::uint32_t>(std::atoi(value.c_str()));
  }
  use_network(network);
  open_network();
  std::signal(SIGTERM, [](int) { ended = 1; });
  try {
    publish(network.station, domain);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "station_emulator: %s\n", e.what());
    return 1;
  }
  return 0;
}
