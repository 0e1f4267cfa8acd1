// What is felt of a hard contact where solves have no more than the daemon's time: haptic_step in a loop of
// ticks, its solves ended at HapticOptions::solve_budget_ns by the machine's clock, as in loop.cpp.
//
// Scenes, one drawn for each seed, 1 ms a tick, μ 0.5, a coupling of 200 N/m, sheets of tissue whose
// compliance falls with distance: flat_stale (a flat tip on a sheet of 7 × 7 nodes and 4 × 4 samples a face,
// 200 to 400 samples under it; one problem throughout, so that what a solve starts from is what the last ones
// left), wedge (a prism between two sheets of 6 × 6 nodes that open by 0.3 to 1 rad), badly_scaled (the tip
// of flat_stale, the nodes' compliances up to 1e12 apart). A stroke presses, draws to and fro, and lets go in
// 600 ticks. It is made once with the budget and once with no deadline, which the forces are against. The
// budget is real time: on a machine with other work the figures are of that machine.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace hapticd {

struct LcpTickPoint {
  std::string kind;  // the case
  int strokes = 0, ticks = 0;
  int capped = 0;              // ticks whose solve ended at its cap or deadline …
  int unusable = 0;            // … with a residual above HapticOptions::usable_residual
  int longest_unusable = 0;    // run of ticks
  int unusable_in_full = 0;    // ticks without a deadline
  double force_error_rms = 0;  // of the strokes' largest: RMS of the difference over RMS of the full force
  double force_error_of_largest = 0;  // … its largest difference over the largest full force
  double moved_rms = 0;               // … RMS of what the full solve, a micrometre sideways, differs by
  double full_force_max = 0;          // [N]
  double full_us_median = 0, full_us_p99 = 0;  // of a tick without a deadline
};

struct LcpTickSettings {
  int strokes = 8;
  std::uint64_t seed = 1;
};

std::vector<std::string> lcp_tick_case_names();

LcpTickPoint chart_lcp_ticks(const std::string& kind, const LcpTickSettings& settings,
                             const std::function<bool(double)>& progress);

}  // namespace hapticd
