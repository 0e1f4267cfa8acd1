// The part of a step's velocity that makes no energy, of a body that another one touches.
//
//   H(x, v) = ½ vᵀMv + E(x);   x⁺ = x + Δx,   v⁺ = v̄ + θ (Δx/h − v̄):   H(x⁺, v⁺) ≤ H(x, v) + fᵀΔx
//
// energy_bound.h keeps less of the motion itself. Where bodies touch, each part that is not kept is overlap:
// a piece that is pushed and turns far in a step would be left inside of what pushes it. Here Δx is kept
// whole, as the contact solve found it, and θ is the largest in [0, 1] that keeps the bound; v̄ is the mean of
// a piece that nothing holds, so momentum stays, and 0 of others. Departure: where E(x⁺) alone is above the
// bound, θ = 0 does not keep it. What is left then is strain, which the next step's implicit Euler loses. A
// motion that takes a tetrahedron's whole volume is bounded as energy_bound.h does. Units: m, N, J. Errors:
// none.
#pragma once

#include "physics/simulation/body.h"

namespace hapticd {

// As correct() with `keeps_energy`, for a dynamic body. of_bodies: what of the contact force is other pieces'
// [N].
void correct_touching(Body& body, const VecX& contact_force, const VecX& of_bodies, double h);

}  // namespace hapticd
