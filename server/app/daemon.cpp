#include "server/app/daemon.h"

#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "haptic/allocation_count.h"
#include "server/dds/dds_sockets.h"
#include "server/observe/dds_log.h"

namespace hapticd {
namespace {

std::vector<Grant> process_grants() { return {keep_malloc_pages(), lock_memory()}; }

// What the process holds in memory [MB].
double resident_mb() {
  std::ifstream in("/proc/self/statm");
  double size = 0, resident = 0;
  in >> size >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

}  // namespace

Daemon::Daemon(const Scene& scene, const DaemonOptions& options)
    : scene_(scene),
      grants_(process_grants()),
      realtime_core_(process_cores().back()),
      simulation_core_(process_cores().front()),
      core_isolation_(realtime_core_),
      on_realtime_core_(std::in_place, realtime_core_),
      domain_(options.domain, default_dds_profile()),
      participant_(domain_, options.security) {
  on_realtime_core_.reset();
  const auto add = [&](const DeviceSettings& device) {
    const bool first = device_sessions_.empty();
    device_sessions_.push_back(std::make_unique<DeviceSession>(
        scene, device, participant_,
        DeviceSessionOptions{options.mode, realtime_core_, simulation_core_, first,
                             first ? options.record : std::nullopt, first ? options.capture : std::nullopt,
                             options.capture_every, first ? options.schedule : std::nullopt}));
  };
  add(scene.device);
  for (const DeviceSettings& device : scene.more_devices) add(device);
  grants_.push_back(latency_.grant());
  grants_.push_back(core_isolation_.grant());
}

Daemon::~Daemon() { stop(); }

void Daemon::start() {
  for (const auto& device_session : device_sessions_) {
    std::vector<Grant> granted = device_session->start_loops();
    // The same for each station: said once.
    if (device_session == device_sessions_.front())
      for (Grant& g : granted) grants_.push_back(std::move(g));
  }
  for (const auto& device_session : device_sessions_) device_session->start_diagnostics(grants_);
}

void Daemon::stop() noexcept {
  for (const auto& device_session : device_sessions_) device_session->stop();
}

bool Daemon::failed() const noexcept {
  for (const auto& device_session : device_sessions_)
    if (device_session->failed()) return true;
  return false;
}

std::string Daemon::failure() const {
  for (const auto& device_session : device_sessions_)
    if (device_session->failed()) return device_session->failure();
  return {};
}

std::string Daemon::metrics() const {
  ProcessMetrics process;
  process.version = HAPTICD_VERSION;
  process.resident_bytes = 1e6 * resident_mb();
  process.uptime_s = 1e-9 * static_cast<double>(monotonic_ns() - made_ns_);
  for (const Grant& g : grants_) process.grants_refused += !g.granted;
  process.packets_refused = packets_refused();
  process.dds_lines = dds_lines();
  process.lines_lost = lines_lost();
  std::vector<MetricsSource> devices;
  for (const auto& device_session : device_sessions_) devices.push_back(device_session->metrics());
  return prometheus_text(process, devices);
}

nlohmann::json Daemon::summary() const {
  nlohmann::json j = device_sessions_.front()->summary();
  j["scene"] = scene_.name;
  j["time_ns"] = monotonic_ns();
  j["rss_mb"] = resident_mb();
  if (allocation_count::available) {
    j["allocations_in_haptic_code"] = allocation_count::in(allocation_count::Region::haptic);
    j["allocations_in_device_port"] = allocation_count::in(allocation_count::Region::transport);
  }
  nlohmann::json grants = nlohmann::json::array();
  for (const Grant& g : grants_)
    grants.push_back({{"what", g.what}, {"granted", g.granted}, {"detail", g.detail}});
  j["grants"] = grants;
  if (device_sessions_.size() > 1) {
    nlohmann::json& more = j["more_devices"] = nlohmann::json::array();
    for (std::size_t i = 1; i < device_sessions_.size(); ++i) more.push_back(device_sessions_[i]->summary());
  }
  return j;
}

}  // namespace hapticd
