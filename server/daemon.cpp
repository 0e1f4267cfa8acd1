#include "server/daemon.h"

#include <future>
#include <nlohmann/json.hpp>

#include "server/scene_world.h"

namespace hapticd {
namespace {

constexpr std::size_t history_ticks = 8192;  // 8 s of ticks may wait for a slow disk
// Rows renewed at 1 kHz need only reach as far as surface and instrument move in a few ticks.
constexpr double haptic_margin = 0.15;  // in alarm distances
// A hyperstatic patch (contact/README.md) may use them all; its residual is then below 1e-4 already.
constexpr int haptic_max_sweeps = 50;

int last_core() { return std::max(1, static_cast<int>(std::thread::hardware_concurrency())) - 1; }

std::vector<Grant> process_grants() { return {keep_malloc_pages(), lock_memory()}; }

HapticOptions haptic_options(const Scene& scene) {
  HapticOptions options;
  options.contact.linearisations = 2;
  options.contact.margin = haptic_margin * scene.alarm_distance;
  options.contact.coulomb.max_sweeps = haptic_max_sweeps;
  return options;
}

nlohmann::json milliseconds(const HistogramSnapshot& h) {
  return {{"p50", 1e-6 * h.percentile(50)},
          {"p99", 1e-6 * h.percentile(99)},
          {"p99_9", 1e-6 * h.percentile(99.9)},
          {"max", 1e-6 * static_cast<double>(h.max)}};
}

}  // namespace

Daemon::Daemon(const Scene& scene, const DaemonOptions& options)
    : scene_(scene),
      world_(make_world(scene)),
      grants_(process_grants()),
      realtime_core_(last_core()),
      on_realtime_core_(std::in_place, realtime_core_),
      domain_(options.domain, default_dds_profile()),
      participant_(domain_, options.security),
      port_(participant_, scene.device.id),
      history_(history_ticks),
      simulation_(*world_, scene.rate, instrument_, problems_, snapshots_),
      haptic_(scene.instrument, scene.device, haptic_options(scene), port_, problems_, instrument_, history_),
      diagnostics_(participant_, scene, haptic_.statistics(), snapshots_, history_, options.record) {
  on_realtime_core_.reset();
  // The first step pays for cold caches and the symbolic factor (150 ms): not on the clock.
  world_->step([] { return InstrumentSample{}; }, problems_.back());
  grants_.push_back(latency_.grant());
}

Daemon::~Daemon() { stop(); }

void Daemon::start() {
  // With one core there is nothing to keep apart.
  if (realtime_core_ > 0)
    simulation_.start([] { use_core(0); });
  else
    simulation_.start();
  std::promise<std::vector<Grant>> granted;
  haptic_.start([&granted, core = realtime_core_] {
    name_thread("haptic");
    prefault_stack();
    granted.set_value({use_core(core), use_fifo(haptic_priority)});
  });
  for (Grant& g : granted.get_future().get()) grants_.push_back(std::move(g));
  diagnostics_.start();
}

void Daemon::stop() noexcept {
  haptic_.stop();
  simulation_.stop();
  diagnostics_.stop();
}

nlohmann::json Daemon::summary() const {
  nlohmann::json j = loop_summary(haptic_.statistics());
  const SimulationStatistics& s = simulation_.statistics();
  const HistogramSnapshot step = s.step.snapshot();
  j["scene"] = scene_.name;
  j["sim_rate_hz"] = s.rate_hz();
  j["sim_steps"] = s.steps.load();
  j["sim_overruns"] = s.overruns.load();
  j["sim_step_ms"] = milliseconds(step);
  j["elements_removed"] = s.removed.load();
  j["fragments_aspirated"] = s.aspirated.load();
  if (s.bases + s.bases_failed > 0) {
    j["bases_adopted"] = s.bases.load();
    j["bases_failed"] = s.bases_failed.load();
    j["base_ms"] = milliseconds(simulation_.base_time().snapshot());
  }
  j["compliance_error_max"] = s.compliance_error.load();
  j["compliance_degraded_steps"] = s.rough_steps.load();
  j["zone_rotation_max_rad"] = s.rotation.load();
  // At the simulation, in scene newtons: the problem before and the new one, solved at the same pose.
  j["sim_force_peak_n"] = s.force_peak.load();
  j["handover_jump_max_n"] = {{"at_base", s.jump_at_base.load()}, {"at_removal", s.jump_at_removal.load()}};
  j["recording_dropped"] = history_.dropped();
  j["recording_failed"] = diagnostics_.recording_failed();
  nlohmann::json grants = nlohmann::json::array();
  for (const Grant& g : grants_)
    grants.push_back({{"what", g.what}, {"granted", g.granted}, {"detail", g.detail}});
  j["grants"] = grants;
  return j;
}

}  // namespace hapticd
