#include "server/app/device_session.h"

#include <future>
#include <nlohmann/json.hpp>

#include "server/observe/log.h"
#include "server/scene/scene_world.h"

namespace hapticd {
namespace {

constexpr std::size_t history_ticks = 8192;  // 8 s of ticks may wait for a slow disk
// What a step asks for grows with the largest patch so far; the port of a tick asks for messages.
constexpr std::size_t simulation_heap = 16 << 20;

nlohmann::json milliseconds(const HistogramSnapshot& h) {
  return {{"p50", 1e-6 * h.percentile(50)},
          {"p99", 1e-6 * h.percentile(99)},
          {"p99_9", 1e-6 * h.percentile(99.9)},
          {"max", 1e-6 * static_cast<double>(h.max)}};
}

std::unique_ptr<World> timed_world(const Scene& scene, PartTimes& times) {
  WorldSettings settings = world_settings(scene);
  settings.compliance_options.times = &times;
  return make_world(scene, settings);
}

}  // namespace

DeviceSession::DeviceSession(const Scene& scene, const DeviceSettings& device, const Participant& participant,
                             const DeviceSessionOptions& options)
    : device_(device),
      options_(options),
      world_(timed_world(scene, times_)),
      port_(participant, device.id, options.mode == LoopMode::event, options.realtime_core),
      history_(history_ticks),
      simulation_(*world_, times_, scene.rate, instrument_, problems_, snapshots_),
      haptic_(scene.instrument, device_, haptic_options(scene), port_, problems_, instrument_, history_,
              LoopTiming{.mode = options.mode}),
      diagnostics_(participant, scene, haptic_.statistics(), snapshots_, history_, options.record,
                   DiagnosticsScope{device.id, options.shows_scene}) {
  haptic_.retune_from(tunings_);
  if (options.schedule) {
    schedule_.emplace(*options.schedule, scene, device_);
    simulation_.record_into(schedule_->steps());
    haptic_.record_into(schedule_->ticks());
  }
  if (options.capture) {
    haptic_.capture_into(captures_, options.capture_every);
    diagnostics_.write_captures(captures_, scene.instrument, *options.capture);
  }
  simulation_.warm_up();
}

DeviceSession::~DeviceSession() { stop(); }

std::vector<Grant> DeviceSession::start_loops() {
  prefault_heap(sample_heap);
  if (schedule_) schedule_->start(options_.realtime_core);
  simulation_.start([this] {
    // With one core there is nothing to keep apart.
    if (options_.realtime_core != options_.simulation_core) use_core(options_.simulation_core);
    prefault_heap(simulation_heap);
  });
  std::promise<std::vector<Grant>> granted;
  haptic_.start([&granted, core = options_.realtime_core] {
    name_thread("haptic");
    no_log_from_this_thread();
    prefault_stack();
    prefault_heap(sample_heap);
    granted.set_value({use_core(core), use_fifo(haptic_priority)});
  });
  return granted.get_future().get();
}

void DeviceSession::start_diagnostics(const std::vector<Grant>& grants) {
  diagnostics_.start(grants, options_.realtime_core);
}

void DeviceSession::retune(const DeviceTuning& tuning) noexcept {
  tunings_.back() = tuning;
  tunings_.publish();
}

void DeviceSession::stop() noexcept {
  haptic_.stop();
  simulation_.stop();
  if (schedule_) schedule_->stop();
  diagnostics_.stop();
}

MetricsSource DeviceSession::metrics() const {
  constexpr auto relaxed = std::memory_order_relaxed;
  const LoopStatistics& h = haptic_.statistics();
  const SimulationStatistics& s = simulation_.statistics();
  MetricsSource m;
  m.device_id = device_.id;
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
  m.foreign_forces = port_.foreign_forces();
  m.solver_caps = h.solver_caps.load(relaxed);
  m.steps = s.steps.load(relaxed);
  m.overruns = s.overruns.load(relaxed);
  m.removed = s.removed.load(relaxed);
  m.aspirated = s.aspirated.load(relaxed);
  m.references = s.references.load(relaxed);
  m.references_failed = s.references_failed.load(relaxed);
  m.page_faults = h.page_faults.load(relaxed);
  m.recording_dropped = history_.dropped();
  m.simulation_rate_hz = s.rate_hz();
  m.force_peak_n = h.force_peak.load(relaxed);
  m.penetration_max_m = h.penetration_max.load(relaxed);
  return m;
}

nlohmann::json DeviceSession::summary() const {
  nlohmann::json j = loop_summary(haptic_.statistics());
  const SimulationStatistics& s = simulation_.statistics();
  const HistogramSnapshot step = s.step.snapshot();
  j["device_id"] = device_.id;
  j["foreign_forces"] = port_.foreign_forces();
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
  j["fragments_aspirated"] = s.aspirated.load();
  if (s.references + s.references_failed > 0) {
    j["references_adopted"] = s.references.load();
    j["references_failed"] = s.references_failed.load();
    j["synchronous_references"] = s.synchronous_references.load();
    j["reference_ms"] = milliseconds(simulation_.reference_time().snapshot());
  }
  j["compliance_error_max"] = s.compliance_error.load();
  j["compliance_degraded_steps"] = s.rough_steps.load();
  j["zone_rotation_max_rad"] = s.rotation.load();
  // At the simulation, in scene newtons: the problem before and the new one, solved at the same pose.
  j["sim_force_peak_n"] = s.force_peak.load();
  j["handover_jump_max_n"] = {{"at_reference", s.jump_at_reference.load()},
                              {"at_removal", s.jump_at_removal.load()}};
  j["recording_dropped"] = history_.dropped();
  j["problems_captured"] = diagnostics_.captured();
  j["recording_failed"] = diagnostics_.recording_failed();
  j["recorded"] = diagnostics_.recorded();
  j["recording_lost"] = diagnostics_.recording_lost();
  if (schedule_) {
    j["schedule_recorded"] = schedule_->recorded();
    j["schedule_lost"] = schedule_->lost();
  }
  return j;
}

}  // namespace hapticd
