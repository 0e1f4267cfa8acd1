// The Delassus operator of contact rows, from the patch's compliance and the virtual coupling.
//
//   W_ij = F_iᵀ (G_ij + B_ij) F_j,   G_ij = Σ_ab w_a w_b C_ab,   B_ij = K_t⁻¹ − [r_i]× K_r⁻¹ [r_j]×  of one
//   instrument, 0 of two; a row between two has B of both, of opposite sign where another knows one alone
//
// H is never formed: a contact touches three nodes (a blade's edge four), so column j of H C Hᵀ is three
// 3-column panels of C weighted, then three 3×3 blocks of that for each i. Symmetric by construction: one
// triangle is computed and mirrored. A fixed obstacle's G is zero; rows.h says what compliance it gets
// instead. Units: W [m/N]. K_inv_diag: diagonal of K_eff⁻¹, world axes [m/N, rad/(N·m)]. Guarantee:
// wait-free, no allocation.
#pragma once

#include "physics/contact/rows.h"

namespace hapticd {

// Fills rows.W() from the frames, arms, samples and edges of `rows`.
void assemble_delassus(const CondensedProblem& problem, const EachInstrument<Vec6>& K_inv_diag,
                       ContactRows& rows) noexcept;

}  // namespace hapticd
