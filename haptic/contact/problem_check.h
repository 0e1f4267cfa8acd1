// Whether a published problem may be felt at all: looked at once, by who publishes it (`known_sound`) or
// else when it is new.
//
//   counts ≤ capacity, node indices < nodes; every number in use finite; μ ≥ 0, weights within ±1e3,
//   ‖outward‖ ≤ 1 + 1e-3; coupling ≥ 0; | ‖q_ref‖ − 1 | ≤ 1e-3; of edges | ‖d‖ − 1 | ≤ 1e-3, limit, advance,
//   viscosity ≥ 0, ids in order; C_ii ≥ 0,  |C_ij − C_ji| ≤ ε,  |C_ij| ≤ √(C_ii C_jj) + ε,  ε = 1e-3 max C_ii
//
// The last line is necessary for a compliance, not sufficient (that takes a Cholesky), and bounds what it
// moves. ε is what approximate compliances may err by; a node that is fixed has C_ii = 0. Guarantee:
// wait-free, no allocation, O((3 · nodes)² + samples).
#pragma once

#include "physics/contact/condensed_problem.h"

namespace hapticd {

bool is_sound(const CondensedProblem& problem) noexcept;

}  // namespace hapticd
