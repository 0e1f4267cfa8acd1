// Projected Gauss-Seidel: what other haptic frameworks run, as a row in charts.
//
//   λ_n ← max(0, λ_n − δ_n/W_nn), at most its limit;  each tangent λ_t ← λ_t − δ_t/W_tt, then back onto the
//   disc ‖λ_t‖ ≤ μ λ_n
//
// One row after another, in the rows' order. Three rows a contact; with an empty μ one row a contact, without
// friction. Residual: coulomb.h's, or lcp.h's. Units: W [m/N], q [m], λ [N].
#pragma once

#include <span>

#include "physics/contact/solver/deadline.h"
#include "physics/types.h"

namespace hapticd {

struct PeerResult {
  bool solved = false;
  int sweeps = 0;
  double residual = 0;
};

PeerResult solve_projected(const MatX& W, const VecX& q, std::span<const double> mu, VecX& lambda,
                           double tolerance, int max_sweeps, const Deadline& deadline,
                           std::span<const double> limit = {});

// Natural map of a frictionless problem, as in lcp.h.
double lcp_residual(const MatX& W, const VecX& q, const VecX& z);

}  // namespace hapticd
