// The largest part of a step's motion that makes no energy, for each piece of a body (fragments.h).
//
//   H(x, v) = ½ vᵀMv + E(x);   Δx ← θ Δx,  v⁺ = Δx/h:   H(x + Δx, v⁺) ≤ H(x, v) + fᵀΔx,   f = f_ext + Hᵀλ
//
// Implicit Euler loses energy, and so does one Newton iteration of it from x_n. A linearisation that is
// foreseen, or stale, promises nothing: a slender body swings for ever, a piece on few nodes flies off. So
// θ is the largest that keeps the bound, to three chords of the excess from ½, ¼, …; θ = 0 keeps it, since
// v⁺ = 0 then. Pieces share no node, so each has its own sum and its own θ: what one loses no other may gain.
// A piece that nothing holds keeps its mean motion, and so its momentum: θ is of the rest.
// The bound is exact to 1e-9 of the energies, a solve's rounding, and to strains of 1e-9: E has every
// element's own rotation at x + Δx, whatever the step was linearised with.
//
// Units: J. Shapes: Δx, f 3·nodes entries; elastic one a piece. Errors: none; a NaN motion is kept out whole.
#pragma once

#include "physics/tissue/fragments.h"

namespace hapticd {

// ½ Σ m ‖v‖² [J]
double kinetic_energy(const TissueModel& model, const TissueState& state) noexcept;

// What a body knows of its energy from one step to the next.
struct EnergyLedger {
  Pieces pieces;          // of the live tissue; none: not known
  VecX elastic;           // E of each at the state [J]; none: not known
  int bounded_steps = 0;  // in a row, whose motion would have made energy
};

struct EnergyBound {
  double share = 1;  // θ, the least
  VecX elastic;      // E at the end of what is kept [J]
  double made = 0;   // what the whole motion would have made, of the energies there are, the most
};

// elastic: E(x) at the state; f: all but the internal forces [N]. dx: the motion, and what is kept of it.
EnergyBound bound_energy(const TissueModel& model, const TissueState& state, const Pieces& pieces,
                         const VecX& elastic, VecX& dx, const VecX& f, double h);

}  // namespace hapticd
