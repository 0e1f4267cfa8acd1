// A body linearised where it is about to be, not where it is.
//
//   x_p = x + Δx_p                                  Δx_p: a step's motion under contact, foreseen
//   R_p = rotations at x_p,  A_p = A(R_p)           factored once: the next step needs no other
//   Δx_free = Δx_p + A_p⁻¹ (M v/h + f_ext + f_int(x_p) − (M (1/h² + α/h) + β/h K_p) Δx_p)
//
// One Newton step of the next time step from x_p instead of x. A published problem is in use from some 0.4 h
// after its pose to 1.4 h: linearised at that pose, tissue that a moving tip comes to has stiffness and shape
// of before it came, and as the energy with rotations held is never below the true one, forces are too high.
// Where nothing moves, x_p = x and this is fresh_free_motion with its factor fresh too. The state is left as
// it was but for the rotations, which are R_p: they are what the compliance holds. Units: SI. Shapes: Δx_p
// has 3·nodes entries. Errors: std::runtime_error from the factor of a singular body.
#pragma once

#include "physics/simulation/body.h"

namespace hapticd {

// Of the corotational law, where no tetrahedron inverts and none is inverted: elsewhere a law linearised at
// x_p is worth nothing, and its factor may not exist. Body::free.dx: Δx_p.
bool can_predict_linearisation(const Body& body);

// Body::free.dx: Δx_p in, Δx_free out; Body::free.predicted: Δx_p.
void linearise_ahead(Body& body, double h);

}  // namespace hapticd
