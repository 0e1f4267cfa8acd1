// Speed against accuracy of a scene's force: what every choice of the daemon costs, and what it buys.
//
//   for each trajectory, without removals and with: reference (of 1 ms, halved until half its step agrees, to
//   0.125 ms at most, with removals 0.0625), every configuration
//   error   of each against the reference of its own mesh: time, coupling and solver (force_error.h)
//   space   where the table names a finest mesh: reference of the own mesh against the finest's, and the
//   whole cost    CPU time per second of scene, of each thread; 99th percentile of the haptic step; memory
//   felt    with removals also: against a reference that loses each element when the problem without it comes
//           into use, so long after the step that took it began. `error` has that delay in it.
//   front   of converged points of one run: nothing else is both cheaper and more accurate
//   windows of a table: parts of the scene's own trajectories, instead of recordings. With a blade each run
//   says
//           what area it separated
//   hands   of several instruments each has its own error; a point's is the worst one's
//
// A run counts only where its reference converged (force_error.h); other points say so and are kept.
// References are kept in a directory between charts, under a hash of all they depend on, this program
// included. Units in the names. Errors: those of the scene, the table and the recordings (InputError).
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tools/chart/force/force_error.h"
#include "tools/chart/force/force_motion.h"
#include "tools/chart/force/force_table.h"
#include "tools/chart/shard.h"

namespace hapticd {

struct ForceChartSettings {
  WindowSettings window;
  // Elements per 20 ms. Along the table's windows: 0 allows those without removals,
  // others those with.
  std::vector<int> removals = {0, 5};
  bool quick = false;           // the table's quick configurations, no finest mesh
  std::filesystem::path cache;  // of references; empty: none are kept
  Shard shard;                  // recordings, with and without removals, or windows of this part alone
};

struct ForcePoint {
  std::string label;
  nlohmann::ordered_json config;
  std::string trajectory;
  int removals = 0;  // along windows 1: by the instruments' own rules
  double cpu_ms_per_s = 0, simulation_ms_per_s = 0, haptic_ms_per_s = 0, references_ms_per_s = 0;
  double simulation_step_ms_p50 = 0, simulation_step_ms_p99 = 0;
  double interim_ms_p50 =
      0;  // from the begin of a step that removes something to its interim problem; 0: none
  double haptic_us_p50 = 0, haptic_us_p99 = 0, memory_mb = 0;
  ForceError error;
  ForceError felt;                                // only with removals
  std::vector<ForceError> hands, felt_hands;      // of each instrument
  double reciprocity = 0, third_law = 0;          // contact_laws.h
  double space_rms_rel = -1, whole_rms_rel = -1;  // < 0: not charted
  double cut_area = 0;                            // [m²]
  int inverted = 0, capped = 0, dropped_samples = 0, uncovered_nodes = 0;
  bool reference_converged = false;
  bool pareto = false;
  double front_factor =
      0;  // largest f for which some point is both f times cheaper and f times better; 1: front
};

// One trajectory with one schedule of removals.
struct ForceRun {
  std::string trajectory;
  int removals = 0;
  int removed = 0;
  double cut_area = 0;            // by the reference [m²]
  double half_step_rel = 0;       // RMS of the reference's step against its half, to the peak
  double reference_step = 0;      // [s]
  double felt_half_step_rel = 0;  // of the worst
  bool felt_converged = true;
  int inverted = 0;
  bool converged = false;
  double reference_cpu_s = 0;
  HandTicks reference;
  struct Trace {
    std::string label;
    HandTicks hands;
  };
  std::vector<Trace> traces;
};

struct ForceChart {
  ShardLedger shard;  // a unit is a run
  std::string default_label;
  std::vector<ForcePoint> points;
  std::vector<ForceRun> runs;
  std::vector<std::string> notes;  // what a reader would wonder about
};

// `progress` is told the fraction done and what is under way; false ends the chart early.
// recordings: where the table has no windows, of a scene with one instrument.
ForceChart chart_force(const Scene& scene, const std::vector<std::filesystem::path>& recordings,
                       const ForceTable& table, const ForceChartSettings& settings,
                       const std::function<bool(double, const std::string&)>& progress);

// Sets `pareto` and `front_factor` of the points of each run.
void mark_front(std::vector<ForcePoint>& points);

}  // namespace hapticd
