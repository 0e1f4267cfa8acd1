// The part of a step's motion that makes no energy, for each piece of a body (fragments.h).
//
//   H(x, v) = ½ vᵀMv + E(x);   Δx ← θ Δx,  v⁺ = Δx/h:   H(x + Δx, v⁺) ≤ H(x, v) + fᵀΔx,   f = f_ext + Hᵀλ
//   Φ(θ) = ½ ‖θ Δx/h − v‖²_M + E(x + θ Δx) − θ fᵀΔx
//
// Implicit Euler loses energy, and so does one Newton iteration of it from x_n. A linearisation that is
// foreseen, or stale, promises nothing: a slender body swings for ever, a piece on few nodes flies off. So
// θ is the largest that keeps the bound, to three chords of the excess from ½, ¼, …; θ = 0 keeps it, since
// v⁺ = 0 then. Of a piece that no contact touches, θ is that of the lowest Φ, which implicit Euler's step
// makes least, where the largest has less than half of what Φ can lose (why is in the source). Pieces share
// no node, so each has its own sum and its own θ: what one loses no other may gain. A piece that nothing
// holds keeps its mean motion, and so its momentum: θ is of the rest. The bound is exact to 1e-9 of the
// energies, a solve's rounding, and to strains of 1e-9: E has every element's own rotation at x + Δx.
//
// Units: J. Shapes: Δx, forces 3·nodes entries; elastic one a piece. Errors: none; a NaN motion is kept out
// whole.
#pragma once

#include "physics/tissue/fragments.h"

namespace hapticd {

// ½ Σ m ‖v‖² [J]
double kinetic_energy(const TissueModel& model, const TissueState& state) noexcept;

// What a body knows of its energy from one step to the next.
struct EnergyLedger {
  Pieces pieces;          // of the live tissue; none: not known
  VecX elastic;           // E of each at the state [J]; none: not known
  int bounded_steps = 0;  // in a row, whose motion would have made energy to speak of, or was hardly kept
};

struct EnergyBound {
  double share = 1;  // θ, the least
  VecX elastic;      // E at the end of what is kept [J]
  double made = 0;   // what the whole motion would have made, of the energies there are, the most
};

// All but the internal forces [N].
struct BodyForces {
  const VecX& external;
  const VecX& contact;  // Hᵀλ
};

// elastic: E(x) at the state. dx: the motion, and what is kept of it.
EnergyBound bound_energy(const TissueModel& model, const TissueState& state, const Pieces& pieces,
                         const VecX& elastic, VecX& dx, const BodyForces& forces, double h);

}  // namespace hapticd
