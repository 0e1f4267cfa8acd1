// The daemon's metrics in Prometheus's text format 0.0.4, made from counters alone.
//
//   hapticd_haptic_wake_seconds{device="0"}      histogram   lateness of a tick against its intended time
//   hapticd_haptic_step_seconds                  histogram   the haptic step of ticks with a contact solve
//   hapticd_haptic_state_age_seconds             histogram   age of the device state that a tick answers
//   hapticd_simulation_step_seconds              histogram   computing one simulation step
//   hapticd_haptic_ticks_total, _slots_missed_total, _deadline_misses_total, _answered_total
//   hapticd_states_rejected_total, hapticd_conflicts_total, hapticd_foreign_forces_total,
//   hapticd_solver_caps_total, hapticd_simulation_steps_total, _overruns_total,
//   hapticd_elements_removed_total, …
//   hapticd_device_info{device,instrument,world}   1: whose device it is; devices of one world share its steps
//   hapticd_packets_refused_total, hapticd_dds_lines_total, hapticd_log_lines_lost_total      of the process
//   hapticd_armed, hapticd_second_daemon, hapticd_force_peak_newtons, …                       gauges
// A daemon with a station has the label `station` besides, on every sample.
//
// A histogram's bounds are 2^k and 1.5·2^k ns, k = 12 … 27 (4 µs to 0.2 s). They are edges of the bins in
// which the loops count (haptic/histogram.h), so no count is split. Units: seconds, newtons, bytes. Errors:
// none.
#pragma once

#include <string>
#include <vector>

#include "haptic/histogram.h"

namespace hapticd {

struct MetricsSource {
  std::uint32_t device_id = 0;
  std::string instrument;  // its name
  int world = 0;           // devices of one world share its tissue and its simulation
  bool armed = false;
  bool second_daemon = false;
  HistogramSnapshot wake, solve, state_age, problem_age, step;
  std::uint64_t ticks = 0, missed = 0, deadline_misses = 0, answered = 0, rejected = 0, conflicts = 0,
                foreign_forces = 0, solver_caps = 0;
  std::uint64_t steps = 0, overruns = 0, removed = 0, aspirated = 0, references = 0, references_failed = 0;
  std::uint64_t page_faults = 0, recording_dropped = 0;
  double simulation_rate_hz = 0, force_peak_n = 0, penetration_max_m = 0;
};

struct ProcessMetrics {
  std::string version;
  std::string station = {};  // a label of every sample; "": none
  double resident_bytes = 0, uptime_s = 0;
  int grants_refused = 0;  // of the real-time set-up
  std::uint64_t packets_refused = 0, dds_lines = 0, lines_lost = 0;
};

std::string prometheus_text(const ProcessMetrics& process, const std::vector<MetricsSource>& devices);

}  // namespace hapticd
