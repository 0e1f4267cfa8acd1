// Time against residual of contact solvers, on sequences as a haptic loop meets them (contact_sequence.h).
//
// Every solver is given the same problems: W and δ_free of the sequence, its own last λ as warm start (warm),
// zero (cold), or its λ of the last linearisation (cases `stale`, blunt otherwise, and `flat_stale`).
// Solvers:
//   pivoting             frictionless, lcp.h
//   hybrid               friction, coulomb.h to a residual of 1e-6, no deadline
//   hybrid_400us         … with a deadline of 400 µs
//   hybrid_1e-10         … to 1e-10, no deadline: the reference that wrench errors are against
//   block_gauss_seidel   the hybrid's exact 3×3 sweeps alone, to 1e-6 within 400 µs
//   pgs                  projected Gauss-Seidel, the peers' solver, to 1e-6 within 400 µs
// failures: answers above their tolerance at the iterations' cap; capped: … at the deadline.
// solved_but_wrong: answers called solved whose natural map, taken anew from W, q, λ and the ε that the
// answer names (of a raised one: also about the forces it is counted from), is above ten times the tolerance.
// raised: answers called solved with a raised ε. Times are of the solver alone, in µs, quantiles over the
// steps; rows, in JSON, counts W's.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tools/chart/solver/contact_sequence.h"
#include "tools/cli/report.h"

namespace hapticd {

struct LcpPoint {
  std::string solver;
  int rows = 0, contacts = 0;
  bool friction = false;
  std::string kind;  // the case
  bool warm = true;
  int steps = 0;
  Quantiles us;
  double residual_median = 0, residual_max = 0;
  int failures = 0, capped = 0;
  int solved_but_wrong = 0, raised = 0;
  double active_median = 0, active_max = 0;
  Quantiles wrench_error;  // relative, where the reference's wrench is above 1e-3 of the largest
};

// How much the compliance that rigid contacts are given changes the wrench, relative.
struct RegularisationPoint {
  int contacts = 0;
  int compared = 0;  // steps where the problem without it was solved to 1e-6
  int unsolved = 0;
  Quantiles wrench_change;
};

struct LcpChart {
  std::vector<LcpPoint> points;
  std::vector<RegularisationPoint> regularisation;
};

struct LcpChartSettings {
  int steps = 10000;
  int peer_steps = 1000;  // of cold starts and of the solvers that are not ours
  std::uint64_t seed = 1;
};

// Cases by name: contact_case_names() and "stale".
std::vector<std::string> lcp_case_names();

// Measures one case at one size; `progress(fraction)` returns false to stop.
void chart_case(const std::string& kind, int contacts, bool friction, const LcpChartSettings& settings,
                const std::function<bool(double)>& progress, LcpChart& chart);

}  // namespace hapticd
