#include "server/app/world_session.h"

#include <algorithm>
#include <future>
#include <nlohmann/json.hpp>

#include "haptic/clock.h"
#include "server/edge/scene_mark.h"
#include "server/files/output_file.h"
#include "server/observe/log.h"
#include "server/scene/scene_world.h"

namespace hapticd {
namespace {

constexpr std::int64_t regions_ns = 6'000'000'000;  // that regions are condensed for, before the clock starts

// What a step asks for grows with the largest patch so far; the port of a tick asks for messages.
constexpr std::size_t simulation_heap = 16 << 20;

nlohmann::json milliseconds(const HistogramSnapshot& h) {
  return {{"p50", 1e-6 * h.percentile(50)},
          {"p99", 1e-6 * h.percentile(99)},
          {"p99_9", 1e-6 * h.percentile(99.9)},
          {"max", 1e-6 * static_cast<double>(h.max)}};
}

std::optional<std::filesystem::path> recording_of(const WorldSessionOptions& options, const Scene& scene,
                                                  int i) {
  if (!options.record) return {};
  return recordings_of(*options.record, scene)[static_cast<std::size_t>(i)];
}

// before: of the same scene; null: none. What it condensed need not be condensed again.
std::unique_ptr<World> timed_world(const Scene& scene, PartTimes& times, const World* before) {
  WorldSettings settings = world_settings(scene);
  settings.compliance_options.times = &times;
  if (!before) return make_world(scene, settings);
  Scene again = scene;
  for (std::size_t b = 0; b < again.bodies.size(); ++b)
    if (before->bodies()[b].model.condensed) again.bodies[b].start = first_start_of(before->bodies()[b]);
  return make_world(again, settings);
}

}  // namespace

std::vector<std::filesystem::path> recordings_of(const std::filesystem::path& file, const Scene& scene) {
  std::vector<std::string> names;
  for (const SceneInstrument& i : scene.instruments) names.push_back(i.name);
  return one_file_each(file, names);
}

std::vector<Grant> start_haptic_thread(HapticLoop& loop, int core) {
  std::promise<std::vector<Grant>> granted;
  loop.start([&granted, core] {
    name_thread("haptic");
    no_log_from_this_thread();
    prefault_stack();
    prefault_heap(sample_heap);
    granted.set_value({use_core(core), use_fifo(haptic_priority)});
  });
  return granted.get_future().get();
}

WorldSession::Device::Device(const DeviceSettings& of, const std::string& name,
                             const Participant& participant, const WorldSessionOptions& options,
                             DdsDevicePort* leader, RemoteHands* hands, int index)
    : settings(of), instrument(name), history(history_ticks) {
  if (hands)
    remote.emplace(*hands, index, settings);
  else
    dds.emplace(participant, of.id, options.mode == LoopMode::event, options.realtime_core, leader);
}

WorldSession::WorldSession(const Scene& scene, const std::vector<DeviceSettings>& devices,
                           const Participant& participant, const Participant& to_edge,
                           const WorldSessionOptions& options)
    : options_(options),
      here_(others_than(options.edge_devices, devices)),
      devices_here_(static_cast<int>(std::count(here_.value.begin(), here_.value.end(), true))) {
  const std::vector<DeviceSettings> answered = as_answered(devices);
  for (int i = 0; i < static_cast<int>(devices.size()); ++i)
    devices_.emplace_back(answered[static_cast<std::size_t>(i)],
                          scene.instruments[static_cast<std::size_t>(i)].name, participant, options,
                          devices_.empty() ? nullptr : devices_.front().leader(),
                          here_[i] ? nullptr : &hands_, i);
  now_ = simulated(scene);
  haptic_.emplace(now_->world->instruments(), loop_devices(), loop_options(scene), now_->problems,
                  instruments_, LoopTiming{.mode = options.mode});
  if (has_edge()) haptic_->share_into(own_);
  for (int i = 0; i < this->devices(); ++i) {
    Device& d = devices_[static_cast<std::size_t>(i)];
    d.diagnostics.emplace(participant, scene, haptic_->statistics(i), d.snapshots, d.history,
                          here_[i] ? recording_of(options, scene, i) : std::nullopt,
                          DiagnosticsScope{d.settings.id, options.world == 0 && i == 0, here_[i]});
  }
  if (has_edge()) {
    LinkSettings link{devices.front().id, scene_mark(scene, here_), this->devices(), here_, {}};
    if (devices_here_ > 0) link.keep_off = options.realtime_core;
    if (devices_here_ > 0)
      edge_.emplace(to_edge, link, copies_, told_, &own_);
    else
      edge_.emplace(to_edge, link, copies_, instruments_);
  }
  if (options.schedule) {
    Scene as_begun = scene;
    as_begun.regions = now_->regions;
    schedule_.emplace(*options.schedule, as_begun, devices);
    now_->loop->record_into(schedule_->steps());
    haptic_->record_into(schedule_->ticks());
  }
  if (options.capture) {
    haptic_->capture_into(captures_, options.capture_every);
    devices_.front().diagnostics->write_captures(captures_, now_->world->instruments(), *options.capture);
  }
  now_->loop->warm_up();
}

WorldSession::Simulated::Simulated(const Scene& of, PartTimes& times, const Simulated* before)
    : scene(&of),
      world(timed_world(of, times, before && before->scene == &of ? before->world.get() : nullptr)),
      regions(world->make_regions(
          [end = before ? 0 : monotonic_ns() + regions_ns](int) { return monotonic_ns() > end; })) {}

std::unique_ptr<WorldSession::Simulated> WorldSession::simulated(const Scene& scene) {
  auto made = std::make_unique<Simulated>(scene, times_, now_.get());
  made->loop.emplace(*made->world, times_, scene.rate, instruments_, made->problems, snapshots());
  if (has_edge()) made->loop->share_into(copies_);
  return made;
}

void WorldSession::rest() noexcept {
  constexpr std::int64_t longest_ns = 500'000'000, look_ns = 1'000'000;  // a Touch's maximum takes 17 ms
  haptic_->withhold(true);
  const std::int64_t until = monotonic_ns() + longest_ns;
  while (!haptic_->at_zero() && monotonic_ns() < until) sleep_until(monotonic_ns() + look_ns);
  now_->loop->stop();
}

void WorldSession::prepare(const Scene& scene, const std::vector<DeviceSettings>& devices) {
  next_ = simulated(scene);
  next_->loop->warm_up();
  next_tick_ = std::make_unique<HapticTick>(next_->world->instruments(), as_answered(devices),
                                            loop_options(scene), next_->problems);
}

// A late pose of the edge's may give a hand here what nobody put in.
HapticOptions WorldSession::loop_options(const Scene& scene) const {
  HapticOptions options = haptic_options(scene);
  options.passivity_control = has_edge() && options_.tank;
  return options;
}

std::vector<DeviceSettings> WorldSession::as_answered(std::vector<DeviceSettings> devices) const {
  for (std::size_t i = 0; i < devices.size(); ++i)
    if (!here_[static_cast<int>(i)]) devices[i] = in_scene(devices[i]);
  return devices;
}

void WorldSession::commit() noexcept {
  next_tick_ = haptic_->exchange(std::move(next_tick_));
  std::swap(now_, next_);
  next_tick_.reset();
  next_.reset();
  for (Device& d : devices_) d.diagnostics->show(*now_->scene);
  start_simulation();
  haptic_->withhold(false);
}

void WorldSession::abandon() noexcept {
  next_tick_.reset();
  next_.reset();
  start_simulation();
  haptic_->withhold(false);
}

Grant WorldSession::start_simulation() {
  std::promise<Grant> granted;
  now_->loop->start([this, &granted] {
    // With one core there is nothing to keep apart.
    if (options_.realtime_core != options_.simulation_core) use_core(options_.simulation_core);
    prefault_heap(simulation_heap);
    granted.set_value(use_nice(simulation_nice));
  });
  return granted.get_future().get();
}

std::vector<LoopDevice> WorldSession::loop_devices() {
  std::vector<LoopDevice> all;
  for (Device& d : devices_) all.push_back({d.settings, d.port(), d.history, &d.tunings});
  return all;
}

std::vector<Channel<SceneSnapshot>*> WorldSession::snapshots() {
  std::vector<Channel<SceneSnapshot>*> all;
  for (Device& d : devices_) all.push_back(&d.snapshots);
  return all;
}

WorldSession::~WorldSession() {
  stop();
  edge_.reset();
  haptic_.reset();
  now_.reset();
  while (!devices_.empty()) devices_.pop_back();  // the first port outlives those that ring its bell
}

std::vector<Grant> WorldSession::start_loops() {
  prefault_heap(sample_heap);
  if (schedule_) schedule_->start(options_.realtime_core);
  std::vector<Grant> granted = {start_simulation()};
  if (edge_) edge_->start();
  if (devices_here_ == 0) return granted;
  for (Grant& g : start_haptic_thread(*haptic_, options_.realtime_core)) granted.push_back(std::move(g));
  return granted;
}

void WorldSession::start_diagnostics(const std::vector<Grant>& grants) {
  for (Device& d : devices_) d.diagnostics->start(grants, options_.realtime_core);
}

void WorldSession::retune(int i, const DeviceTuning& tuning) noexcept {
  if (!here_[i]) return;
  Channel<DeviceTuning>& tunings = devices_[static_cast<std::size_t>(i)].tunings;
  tunings.back() = tuning;
  tunings.publish();
}

std::uint64_t WorldSession::haptic_turns() const noexcept {
  return devices_here_ == 0 ? edge_->turns() : haptic_->statistics(0).run.load(std::memory_order_relaxed);
}

void WorldSession::stop() noexcept {
  haptic_->stop();
  if (edge_) edge_->stop();
  now_->loop->stop();
  if (schedule_) schedule_->stop();
  for (Device& d : devices_) d.diagnostics->stop();
}

MetricsSource WorldSession::metrics(int i) const {
  constexpr auto relaxed = std::memory_order_relaxed;
  const LoopStatistics& h = haptic_->statistics(i);
  const SimulationStatistics& s = now_->loop->statistics();
  MetricsSource m;
  m.device_id = device_id(i);
  m.instrument = device(i).instrument;
  m.world = options_.world;
  m.ticks = h.run.load(relaxed);
  m.armed = m.ticks > 0 && (h.status.load(relaxed) & status_disarmed) == 0;
  m.wake = h.wake.snapshot();
  m.solve = h.solve.snapshot();
  m.state_age = h.state_age.snapshot();
  m.problem_age = h.problem_age.snapshot();
  m.step = s.step.snapshot();
  m.missed = h.missed.load(relaxed);
  m.deadline_misses = h.deadline_misses.load(relaxed);
  m.answered = h.answered.load(relaxed);
  m.rejected = h.refused.load(relaxed);
  m.conflicts = h.conflicts.load(relaxed);
  m.second_daemon = (h.status.load(relaxed) & status_rival) != 0;
  m.foreign_forces = device(i).foreign_forces();
  m.solver_caps = h.solver_caps.load(relaxed);
  m.steps = s.steps.load(relaxed);
  m.overruns = s.overruns.load(relaxed);
  m.removed = s.removed.load(relaxed);
  m.aspirated = s.aspirated.load(relaxed);
  m.references = s.references.load(relaxed);
  m.references_failed = s.references_failed.load(relaxed);
  m.page_faults = h.page_faults.load(relaxed);
  m.recording_dropped = recording_dropped(i);
  m.simulation_rate_hz = s.rate_hz();
  m.force_peak_n = h.force_peak.load(relaxed);
  m.penetration_max_m = h.penetration_max.load(relaxed);
  return m;
}

nlohmann::json WorldSession::summary(int i) const {
  const Diagnostics& diagnostics = *device(i).diagnostics;
  nlohmann::json j = loop_summary(haptic_->statistics(i));
  const SimulationStatistics& s = now_->loop->statistics();
  const HistogramSnapshot step = s.step.snapshot();
  j["device_id"] = device_id(i);
  if (devices() > 1) j["instrument"] = device(i).instrument;
  if (!here_[i]) j["answered_by"] = "edge";
  j["foreign_forces"] = device(i).foreign_forces();
  j["mode"] = options_.mode == LoopMode::event ? "event" : "tick";
  j["sim_rate_hz"] = s.rate_hz();
  j["sim_steps"] = s.steps.load();
  j["sim_overruns"] = s.overruns.load();
  j["sim_step_ms"] = milliseconds(step);
  // From the begin of a step that removes something to the problem without it.
  if (const HistogramSnapshot interim = s.interim.snapshot(); interim.count > 0) {
    j["interim_problems"] = interim.count;
    j["interim_ms"] = milliseconds(interim);
  }
  if (const HistogramSnapshot refresh = s.refresh.snapshot(); refresh.count > 0) {
    j["refreshed_problems"] = refresh.count;
    j["refresh_ms"] = milliseconds(refresh);
  }
  j["removals_without_interim"] = s.late_removals.load();
  j["elements_removed"] = s.removed.load();
  j["cut_steps"] = s.cut_steps.load();
  j["out_of_room"] = s.out_of_room.load();
  j["condensed_steps"] = s.condensed_steps.load();
  j["fragments_aspirated"] = s.aspirated.load();
  if (s.references + s.references_failed > 0) {
    j["references_adopted"] = s.references.load();
    j["references_failed"] = s.references_failed.load();
    j["synchronous_references"] = s.synchronous_references.load();
    j["reference_ms"] = milliseconds(now_->loop->reference_time().snapshot());
  }
  j["compliance_error_max"] = s.compliance_error.load();
  j["compliance_degraded_steps"] = s.rough_steps.load();
  j["zone_rotation_max_rad"] = s.rotation.load();
  // At the simulation, in scene newtons: the problem before and the new one, solved at the same pose.
  j["sim_force_peak_n"] = s.force_peak.load();
  j["handover_jump_max_n"] = {{"at_reference", s.jump_at_reference.load()},
                              {"at_removal", s.jump_at_removal.load()}};
  if (i == 0) {
    j["operation"] = to_json(now_->loop->operation());
    j["operation"]["began_ns"] = s.first_ns.load();
  }
  if (i == 0 && edge_) j["edge"] = edge_->summary();
  j["recording_dropped"] = recording_dropped(i);
  j["problems_captured"] = diagnostics.captured();
  j["recording_failed"] = diagnostics.recording_failed();
  j["recorded"] = diagnostics.recorded();
  j["recording_lost"] = diagnostics.recording_lost();
  if (schedule_) {
    j["schedule_recorded"] = schedule_->recorded();
    j["schedule_lost"] = schedule_->lost();
  }
  return j;
}

}  // namespace hapticd
