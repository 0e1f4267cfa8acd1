// The Delassus operator of contact rows, from the patch's compliance and the virtual coupling.
//
//   W_ij = F_iᵀ (G_ij + B_ij) F_j,   G_ij = Σ_ab w_a w_b C_ab,   B_ij = K_t⁻¹ − [r_i]× K_r⁻¹ [r_j]×  of one
//   instrument, 0 of two; a row between two has B of both, of opposite sign where another knows one alone
//
// All of it; column by column, as it is asked for: delassus_columns.h. A fixed obstacle's G is zero; rows.h
// says what compliance it gets instead. Units: W [m/N]. K_inv_diag: diagonal of K_eff⁻¹, world axes [m/N,
// rad/(N·m)]. Guarantee: wait-free, no allocation.
#pragma once

#include "physics/contact/rows.h"

namespace hapticd {

// Fills rows.W() from the frames, arms, samples and edges of `rows`.
void assemble_delassus(const CondensedProblem& problem, const EachInstrument<Vec6>& K_inv_diag,
                       ContactRows& rows) noexcept;

}  // namespace hapticd
