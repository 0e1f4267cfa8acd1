#include "server/app/daemon.h"

#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "haptic/allocation_count.h"
#include "haptic/clock.h"
#include "server/dds/dds_sockets.h"
#include "server/dds/network.h"
#include "server/observe/dds_log.h"
#include "server/observe/log.h"
#include "server/scene/scene_world.h"

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
    : scene_(&scene),
      grants_(process_grants()),
      realtime_core_(process_cores().back()),
      simulation_core_(process_cores().front()),
      core_isolation_(realtime_core_),
      on_realtime_core_(std::in_place, realtime_core_),
      domain_(options.domain,
              options.edge_domain ? read_dds_profile(default_dds_profile_name()) : default_dds_profile()),
      participant_(domain_, options.security) {
  on_realtime_core_.reset();
  if (options.edge_domain) {
    const ScopedCore elsewhere(simulation_core_);  // its threads are not to hold up the haptic loop
    edge_domain_.emplace(*options.edge_domain, default_dds_profile());
    edge_participant_.emplace(*edge_domain_, options.security);
  }
  const auto add = [&](const std::vector<DeviceSettings>& devices) {
    const bool first = sessions_.empty();
    sessions_.push_back(std::make_unique<WorldSession>(
        scene, devices, participant_, edge_participant_ ? *edge_participant_ : participant_,
        WorldSessionOptions{options.mode, realtime_core_, simulation_core_,
                            static_cast<int>(sessions_.size()), first ? options.record : std::nullopt,
                            first ? options.capture : std::nullopt, options.capture_every,
                            first ? options.schedule : std::nullopt, options.edge_devices, options.tank}));
  };
  add(devices_of(scene));
  for (const DeviceSettings& device : scene.more_devices) add({device});
  try {
    commands_.emplace(participant_);
  } catch (const std::runtime_error& e) {
    log(LogLevel::warning, "no_commands",
        std::string("no commands over DDS (keys of an older version? run make_keys.sh again): ") + e.what());
  }
  grants_.push_back(latency_.grant());
  grants_.push_back(core_isolation_.grant());
}

Daemon::~Daemon() { stop(); }

void Daemon::start() {
  for (const auto& session : sessions_) {
    std::vector<Grant> granted = session->start_loops();
    // The same for each station: said once.
    if (session == sessions_.front())
      for (Grant& g : granted) grants_.push_back(std::move(g));
  }
  for (const auto& session : sessions_) session->start_diagnostics(grants_);
}

void Daemon::stop() noexcept {
  for (const auto& session : sessions_) session->stop();
}

void Daemon::reset() {
  simulate([this]() -> const Scene& { return *scene_; });
}

void Daemon::restart(const std::function<Scene()>& make) {
  std::unique_ptr<const Scene> next;
  simulate([&]() -> const Scene& {
    next = std::make_unique<const Scene>(make());
    return *next;
  });
  scene_ = next.get();
  former_ = std::exchange(own_, std::move(next));
}

void Daemon::simulate(const std::function<const Scene&()>& scene_to_run) {
  for (const auto& session : sessions_)
    if (!session->may_restart())
      throw std::runtime_error("not while a schedule or captures are written: they are of one simulation");
  for (const auto& session : sessions_) session->rest();
  try {
    const Scene& scene = scene_to_run();
    for (std::size_t i = 0; i < sessions_.size(); ++i)
      sessions_[i]->prepare(scene, i == 0 ? devices_of(scene) : std::vector{scene.more_devices.at(i - 1)});
  } catch (...) {
    for (const auto& session : sessions_) session->abandon();
    throw;
  }
  const std::lock_guard no_figures(exchange_);
  for (const auto& session : sessions_) session->commit();
}

bool Daemon::failed() const noexcept {
  for (const auto& session : sessions_)
    if (session->failed()) return true;
  return false;
}

std::string Daemon::failure() const {
  for (const auto& session : sessions_)
    if (session->failed()) return session->failure();
  return {};
}

std::string Daemon::metrics() const {
  ProcessMetrics process;
  process.version = HAPTICD_VERSION;
  process.station = process_network().station;
  process.resident_bytes = 1e6 * resident_mb();
  process.uptime_s = 1e-9 * static_cast<double>(monotonic_ns() - made_ns_);
  for (const Grant& g : grants_) process.grants_refused += !g.granted;
  process.packets_refused = packets_refused();
  process.dds_lines = dds_lines();
  process.lines_lost = lines_lost();
  const std::lock_guard no_exchange(exchange_);
  std::vector<MetricsSource> devices;
  for (const auto& session : sessions_)
    for (int i = 0; i < session->devices(); ++i) devices.push_back(session->metrics(i));
  return prometheus_text(process, devices);
}

nlohmann::json Daemon::summary() const {
  nlohmann::json j = sessions_.front()->summary(0);
  j["scene"] = scene_->name;
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
  nlohmann::json more = nlohmann::json::array();
  for (const auto& session : sessions_)
    for (int i = session == sessions_.front() ? 1 : 0; i < session->devices(); ++i)
      more.push_back(session->summary(i));
  if (!more.empty()) j["more_devices"] = std::move(more);
  return j;
}

}  // namespace hapticd
