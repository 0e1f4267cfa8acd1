// The instruments on their virtual couplings, as a contact solve of either loop begins and ends.
//
//   e = X_device ⊖ X_instrument:  K e + B (e − e_prev)/T + Jᵀλ = 0,   K_eff = K + B/T
//   X_free = X_device ⊖ K_eff⁻¹ (B/T) e_prev,   X_instrument = X_free ⊕ K_eff⁻¹ Jᵀ λ
//
// The instrument is massless (a proxy); a stiffness of zero means held rigidly (K⁻¹ = 0, no lag). Units: m,
// N, s. Guarantee: wait-free, no allocation.
#pragma once

#include "physics/contact/condensed_problem.h"

namespace hapticd {

// K_eff⁻¹ = (K (1 + damping_time/T))⁻¹, diagonal in world axes; zero where K is zero.
Vec6 inverse_stiffness(const VirtualCoupling& coupling, double period) noexcept;

// The instruments on their couplings, for a solve of either loop.
struct CouplingStart {
  EachInstrument<Vec6> K_inv;
  InstrumentPoses
      X_free;  // with what the couplings' dampers still hold of the last offset, and under its load
  InstrumentPoses X_start;  // with the whole of it: where the last solve has put them
};
CouplingStart start_coupling(const CondensedProblem& problem, const InstrumentPoses& X_device, double period,
                             const EachInstrument<Vec6>& last_offset) noexcept;

// … and what the next one is to know; zero of a stiffness of zero, and of who is not present.
EachInstrument<Vec6> coupling_offset(const InstrumentPoses& X_device, const InstrumentPoses& X_instrument,
                                     const EachInstrument<Vec6>& K_inv) noexcept;

// X_free ⊕ K_eff⁻¹ Jᵀλ.
InstrumentPoses placed_by(const CouplingStart& start, const EachInstrument<Vec6>& wrench) noexcept;

}  // namespace hapticd
