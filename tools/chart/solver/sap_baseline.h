// A convex formulation of contact with friction, solved by Newton with an exact line search: a baseline in
// charts, after Drake's SAP.
//
//   min over λ' of ½ λ'ᵀ W λ' + Σ_i ℓ_i(δ_i),  δ = W λ' + q,  ℓ_i = R_i/2 ‖γ_i‖²,  γ_i = P_K(−δ_i / R_i)
//
// At the minimum λ' = γ. R_i = relative_diagonal · tr W_ii / rows of a contact; K is the friction cone, P_K
// the projection onto it. It always converges, to another law: a contact that slides opens by μ ‖δ_t‖
// (associated flow), so its natural map (coulomb.h) does not go to zero with R. Newton's matrix is W + W G W,
// G = −∂γ/∂δ ≥ 0, solved with as many unknowns as G has rank. Three rows a contact; with an empty μ one row a
// contact, without friction. Units: W [m/N], q [m], λ [N]. Errors: `solved` false: at the cap, the deadline
// or a factor that failed. Allocates. Source: Castro, Permenter and Han, "An unconstrained convex formulation
// of compliant contact", IEEE T-RO 2023, §V; departures: unknowns are the contacts', not the bodies'
// velocities, and R is the same in all directions.
#pragma once

#include <span>

#include "physics/contact/solver/deadline.h"
#include "physics/types.h"

namespace hapticd {

struct SapOptions {
  double relative_diagonal = 1e-6;
  double tolerance = 1e-7;  // on ‖λ' − γ‖, in the norm of W, to ‖γ‖ or ‖λ'‖
  int max_newton = 200;
  Deadline deadline;
};

struct SapResult {
  bool solved = false;
  int newton = 0;
};

// lambda is read as warm start and left as γ.
SapResult solve_sap(const MatX& W, const VecX& q, std::span<const double> mu, VecX& lambda,
                    const SapOptions& options);

}  // namespace hapticd
