#include "server/app/edge_session.h"

#include <nlohmann/json.hpp>

#include "server/dds/network.h"
#include "server/edge/scene_mark.h"
#include "server/scene/scene_world.h"

namespace hapticd {
namespace {

HapticOptions haptic_of(const Scene& scene, const EdgeOptions& options) {
  HapticOptions haptic = haptic_options(scene);
  haptic.passivity_control = options.tank;
  if (options.late > 0) let_problems_grow_old(haptic.watchdog, options.late);
  return haptic;
}

EachInstrument<bool> elsewhere(const Scene& scene, const std::vector<std::uint32_t>& here) {
  return here.empty() ? EachInstrument<bool>() : others_than(here, devices_of(scene));
}

std::string near_profile() { return read_dds_profile(default_dds_profile_name()); }

}  // namespace

EdgeSession::Device::Device(const DeviceSettings& of, const Participant& participant,
                            const EdgeOptions& options, int core, Port* leader, const EdgeEnd& link,
                            RemoteHands* hands, int index)
    : settings(hands ? in_scene(of) : of), history(history_ticks) {
  if (hands)
    remote.emplace(*hands, index, settings);
  else
    here.emplace(participant, of.id, options.mode == LoopMode::event, core, leader, link);
}

EdgeSession::EdgeSession(const Scene& scene, const EdgeOptions& options)
    : grants_{keep_malloc_pages(), lock_memory()},
      realtime_core_(process_cores().back()),
      core_isolation_(realtime_core_),
      on_realtime_core_(std::in_place, realtime_core_),
      domain_(options.domain, near_profile()),
      participant_(domain_, options.security),
      instruments_(shapes_of(scene)),
      at_simulation_(elsewhere(scene, options.devices)) {
  on_realtime_core_.reset();
  if (options.simulation_domain != options.domain) {
    const ScopedCore elsewhere(process_cores().front());  // its threads are not to hold up the haptic loop
    far_domain_.emplace(options.simulation_domain, default_dds_profile());
    far_participant_.emplace(*far_domain_, options.security);
  }
  const std::vector<DeviceSettings> settings = devices_of(scene);
  link_.emplace(simulation_side(),
                LinkSettings{settings.front().id, scene_mark(scene, at_simulation_),
                             static_cast<int>(settings.size()), at_simulation_, realtime_core_},
                inputs_, problems_, &others_);
  std::vector<LoopDevice> loop_devices;
  for (int i = 0; i < static_cast<int>(settings.size()); ++i) {
    Port* const leader = devices_.empty() || !devices_.front().here ? nullptr : &*devices_.front().here;
    Device& d =
        devices_.emplace_back(settings[static_cast<std::size_t>(i)], participant_, options, realtime_core_,
                              leader, *link_, at_simulation_[i] ? &hands_ : nullptr, i);
    loop_devices.push_back({d.settings, d.port(), d.history});
  }
  haptic_.emplace(instruments_, loop_devices, haptic_of(scene, options), problems_, inputs_,
                  LoopTiming{.mode = options.mode});
  for (std::size_t i = 0; i < devices_.size(); ++i) {
    Device& d = devices_[i];
    std::optional<std::filesystem::path> record;
    if (options.record && d.here) record = recordings_of(*options.record, scene)[i];
    d.diagnostics.emplace(
        participant_, scene, haptic_->statistics(static_cast<int>(i)), d.snapshots, d.history, record,
        DiagnosticsScope{
            .device_id = d.settings.id, .shows_scene = false, .shows_device = d.here.has_value()});
  }
  grants_.push_back(latency_.grant());
  grants_.push_back(core_isolation_.grant());
}

EdgeSession::~EdgeSession() {
  stop();
  haptic_.reset();
  while (!devices_.empty()) devices_.pop_back();  // the first port outlives those that ring its bell
}

void EdgeSession::start() {
  link_->start();
  for (Grant& g : start_haptic_thread(*haptic_, realtime_core_)) grants_.push_back(std::move(g));
  for (Device& d : devices_) d.diagnostics->start(grants_, realtime_core_);
}

void EdgeSession::stop() noexcept {
  haptic_->stop();
  for (Device& d : devices_) d.diagnostics->stop();
  link_->stop();
}

nlohmann::json EdgeSession::summary() const {
  const auto of = [this](std::size_t i) {
    const Device& d = devices_[i];
    nlohmann::json j = loop_summary(haptic_->statistics(static_cast<int>(i)));
    j["device_id"] = d.settings.id;
    if (d.here)
      j["foreign_forces"] = d.here->foreign_forces();
    else
      j["answered_by"] = "simulation";
    j["recorded"] = d.diagnostics->recorded();
    j["recording_lost"] = d.diagnostics->recording_lost();
    return j;
  };
  nlohmann::json j = of(0), more = nlohmann::json::array();
  for (std::size_t i = 1; i < devices_.size(); ++i) more.push_back(of(i));
  if (!more.empty()) j["more_devices"] = std::move(more);
  j["edge"] = link_->summary();
  nlohmann::json grants = nlohmann::json::array();
  for (const Grant& g : grants_)
    grants.push_back({{"what", g.what}, {"granted", g.granted}, {"detail", g.detail}});
  j["grants"] = grants;
  return j;
}

}  // namespace hapticd
