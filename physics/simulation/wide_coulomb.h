// Coulomb contact for more contacts than the haptic loop's fixed workspace holds: the simulation's solver.
//
//   the problem, cone, residual and options of contact/coulomb.h; circular cone, nonlinear complementarity
//
// The same hybrid: exact block sweeps, then a reduced Newton on Alart and Curnier's sorting with
// backtracking; contacts that a step would pull on leave the system together. A contact whose tangents W does
// not move (rows and columns of zeros) is frictionless. Units: W [m/N], q [m], λ [N]; rows ordered n, t1, t2
// per contact. λ is read as warm start. Errors: as `solve_coulomb`. Allocates: for the simulation thread
// only.
#pragma once

#include "physics/contact/coulomb.h"

namespace hapticd {

CoulombResult solve_wide_coulomb(const MatX& W, const VecX& q, std::span<const double> mu, VecX& lambda,
                                 const CoulombOptions& options);

}  // namespace hapticd
