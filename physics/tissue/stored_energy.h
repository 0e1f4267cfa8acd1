// The elastic energy of a body at positions that it is not at.
//
//   E(x + Δx) = Σ_e V_e (μ‖F−R‖² + λ/2 tr(RᵀF−I)²) + guards,   R: nearest to F at x + Δx
//
// Every live tetrahedron has its own nearest rotation there, found from the state's, which stays; of a linear
// model R is the identity, F its symmetric part, and no guard. Where the state's rotations are those of x, it is
// elastic_energy (tissue.h) at Δx = 0. Units: m, J. Shapes: Δx 3·nodes entries. Guarantee: no allocation.
#pragma once

#include "physics/tissue/fragments.h"

namespace hapticd {

double stored_energy(const TissueModel& model, const TissueState& state, const VecX& dx) noexcept;

// Of each piece; `energy` has pieces.count() entries.
void stored_energies(const TissueModel& model, const TissueState& state, const Pieces& pieces, const VecX& dx,
                     VecX& energy) noexcept;

}  // namespace hapticd
