// The law of cutting (edge_sample.h) as rows, and the advance that their solution makes.
//
//   row: n = d, δ_n,free as of any contact (rows.h) with gap = δ_e at the linearisation, λ_n ≤ limit
//   where it is viscous, a second one at the same place: no limit, W_nn + T/(c w_e); λ_e is the sum of both
//   after a solve: advance ← advance + max(0, −δ_n − W_nn (limit − λ_n)) of the first
//
// The last term is what the solver's tolerance leaves at the limit; below it δ_n ≥ 0, and nothing advances.
// On withdrawing δ_n grows and λ_n falls at once; nothing heals. A front that was realised further than what
// is remembered counts as it was published. Units: m, N. Guarantee: wait-free, no allocation.
#pragma once

#include "physics/contact/rows.h"

namespace hapticd {

// Place of the front when the patch's nodes are at x.
Vec3 front_position(const CondensedProblem& problem, const PatchPositions& x, int edge) noexcept;

// The total that a front's row counts from [m]; known: null where nothing is remembered.
double total_advance(const EdgeSample& edge, const ContactMemory::Entry* known) noexcept;

// Behind the rows there are, by id: one or two of each edge sample of an instrument that is present.
// period: T [s].
void add_edges(const CondensedProblem& problem, const InstrumentPoses& X_free, const InstrumentPoses& X_lin,
               const PatchPositions& x_lin, const ContactMemory& memory, double period,
               ContactRows& rows) noexcept;

// How many there will be.
int count_edges(const CondensedProblem& problem, const InstrumentPoses& X_lin) noexcept;

// The total of an edge's row after a solve that ended with these λ_n and δ_n [m].
double advance_after(const ContactRow& row, double W_nn, double lambda_n, double delta_n) noexcept;

// How far the front of an edge sample is to move along d so that it is where `memory` has it [m], ≥ 0: what a
// step realises by subdivision after its own solve.
double advance_to_realise(const CondensedProblem& problem, const ContactMemory& memory, int edge) noexcept;

}  // namespace hapticd
