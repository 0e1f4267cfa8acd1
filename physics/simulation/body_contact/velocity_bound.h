// The part of a step's velocity that makes no energy, of a body that another one is near.
//
//   H(x, v) = ½ vᵀMv + E(x);   x⁺ = x + Δx,   v⁺ = v̄ + θ (Δx/h − v̄):   H(x⁺, v⁺) ≤ H(x, v) + fᵀΔx
//
// energy_bound.h keeps less of the motion itself. Where bodies are near, each part that is not kept may be
// overlap: a piece that turns far in a step would be left inside of what gave way to it. Here Δx is kept
// whole, as the contact solve found it, and θ is the largest in [0, 1] that keeps the bound; v̄ is the mean of
// a piece that nothing holds, so momentum stays, and 0 of others. Departure: where E(x⁺) alone is above the
// bound, θ = 0 does not keep it. What is left then is strain, which the next step's implicit Euler loses.
// Units: m, N, J. Errors: none.
#pragma once

#include <span>

#include "physics/simulation/body.h"

namespace hapticd {

// As correct() with `keeps_energy`, for a dynamic body. near: nodes of its that other pieces may touch.
void correct_touching(Body& body, const VecX& contact_force, std::span<const int> near, double h,
                      const VecX* response = nullptr);

}  // namespace hapticd
