// Frictionless contacts of bodies and the instrument's with friction, in one problem.
//
//   δ_b = W_bb λ_b + W_tbᵀ λ_t + q_b,  0 ≤ δ_b ⟂ λ_b ≥ 0;   δ_t = W_tt λ_t + W_tb λ_b + q_t,  λ_t as
//   coulomb.h A: bodies' contacts taken for closed, S = (W_AA + ε D)⁻¹: (W_tt − W_tA S W_At) λ_t + q_t − W_tA
//   S q_A  is the instrument's problem,  λ_A = −S (q_A + W_At λ_t)
//
// A is what the LCP of the bodies (lcp.h, which always ends) closes under the last λ_t. When it closes the
// same again, this is the solution of the problem above, for Coulomb solves of the instrument's contacts
// alone. Nothing proves that it comes to that: it gives up where the number of changes falls no more, and
// the caller solves all as one Coulomb problem.
// Units: W [m/N], q [m], λ [N]. Shapes: W_tb 3 rows a contact of the instrument. Residual: natural map, of
// bodies or instrument, the larger. Allocates: for the simulation thread only.
#pragma once

#include <span>

#include "physics/contact/solver/coulomb.h"
#include "physics/contact/solver/lcp.h"

namespace hapticd {

struct EliminationResult {
  bool solved = false;  // else λ is as it was
  double residual = 0;
};

// Pre: the workspaces hold as many rows and contacts.
EliminationResult solve_eliminated(const MatX& W_bb, const VecX& q_b, VecX& lambda_b, const MatX& W_tb,
                                   const MatX& W_tt, const VecX& q_t, std::span<const double> mu,
                                   std::span<const double> limit, VecX& lambda_t, LcpWorkspace& lcp,
                                   CoulombWorkspace& coulomb, const CoulombOptions& options);

}  // namespace hapticd
