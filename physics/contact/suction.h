// Suction: what a port's vacuum pulls tissue with, and the instrument against it.
//
//   w_i = A_i φ(g_i) ψ(ρ_i),   o = min(1, Σ w_i/(0.9 A)),   f_i = −p A o (w_i/Σ w) d,   load = −Σ (f_i, r_i ×
//   f_i) x_free ← x_free + C_pp f,   X_free ← X_free ⊕ K_eff⁻¹ load
//
// d: direction of the port, out of it; A its area; g the sample's gap to the instrument, φ = 1 to half of the
// reach and 0 beyond it; ρ its distance from the port's axis, ψ = 1 to 0.8 and 0 from 1.2 radii. So a port
// that is covered pulls with p A exactly, and a sample that comes in does so by degrees. Contact forces stay
// λ_n ≥ 0 on top of it, which is λ_n − p A ≥ −p A of what the tip and tissue exchange, and friction is that
// of λ. Samples of fixed obstacles have no area here: they neither cover a port nor pull.
//
// φ and ψ are of where tissue was. What yields by more than their width in a tick would be pulled and let go
// in turn: with a Grip g ← g + share (φψ − g), 0 where φψ is, in their place, that is by degrees.
//
// Pump (implicit Euler): τ ṗ = p_max o − p while it is on, τ ṗ = −p while off. One with a flow Q is
// peristaltic: C ṗ = Q o − (1 − o) p C/τ, C = Q τ/p_max the compliance of its tubing, 0 ≤ p ≤ p_max: it rises
// evenly within τ where the port is covered, and vents as far as it is open.
// Units: m, N, Pa. Guarantee: wait-free, no allocation, bounded by max_patch_samples. Departure from DESIGN
// §13: a load in place of a shift of λ, which tissue that is no row yet feels as well.
#pragma once

#include "physics/contact/rows.h"

namespace hapticd {

struct Suction {
  double occlusion = 0;      // o
  Vec6 load = Vec6::Zero();  // on the instrument, about its origin [N, N·m]
};

// Of one port: how far it holds each sample, 0 … 1.
using Grip = std::array<double, max_patch_samples>;

// Of one instrument's port at pose X over the patch at x, with vacuum p; adds f to `pull`, by patch node [N].
// share: of the way to φψ that the grip goes.
Suction suction_of(const CondensedProblem& problem, const Instrument& shape, const Pose& X,
                   const PatchPositions& x, double vacuum, PatchPositions& pull, Grip* grip = nullptr,
                   double share = 1) noexcept;

// The pump's next pressure.
double pumped(const Port& port, double vacuum, double occlusion, bool on, double period) noexcept;

// With each instrument's vacuum [Pa] where it is present: shifts x_free and sets pull, loads and ways. X, x:
// where the last solve left instruments and patch; X_next: where they are about to be. Returns the
// occlusions.
EachInstrument<double> apply_suction(Instruments instruments, const InstrumentPoses& X,
                                     const InstrumentPoses& X_next, const PatchPositions& x,
                                     const EachInstrument<double>& vacuum, CondensedProblem& problem,
                                     EachInstrument<Grip>* grip = nullptr, double share = 1) noexcept;

// What a solve moved from `before` to x farther than the port is wide and reaches was thrown, not drawn: its
// grip is 0 from then. Whether there was any.
bool let_go(const CondensedProblem& problem, Instruments instruments, const PatchPositions& before,
            const PatchPositions& x, EachInstrument<Grip>& grip) noexcept;

// Takes it out of the problem again.
void remove_suction(CondensedProblem& problem) noexcept;

// Whether any of them has a port.
bool any_port(Instruments instruments) noexcept;

}  // namespace hapticd
