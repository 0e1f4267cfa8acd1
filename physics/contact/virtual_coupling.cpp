// Coupling: it enters W as J K_eff⁻¹ Jᵀ, and the free instrument pose is X_device ⊖ K_eff⁻¹ (B/T) e_prev.
// Virtual work fixes the wrench's sign.
#include "physics/contact/virtual_coupling.h"

namespace hapticd {

Vec6 inverse_stiffness(const VirtualCoupling& coupling, double period) noexcept {
  const double damped = 1 + coupling.damping_time / period;
  Vec6 K_inv;
  K_inv.head<3>().setConstant(coupling.stiffness > 0 ? 1 / (coupling.stiffness * damped) : 0);
  K_inv.tail<3>().setConstant(coupling.rotational_stiffness > 0 ? 1 / (coupling.rotational_stiffness * damped)
                                                                : 0);
  return K_inv;
}

CouplingStart start_coupling(const CondensedProblem& problem, const InstrumentPoses& X_device, double period,
                             const EachInstrument<Vec6>& last_offset) noexcept {
  CouplingStart start;
  start.X_free = start.X_start = X_device;
  for (int i = 0; i < max_instruments; ++i) {
    if (!X_device.present[i]) continue;
    const VirtualCoupling& coupling = problem.instrument[i].coupling;
    const Vec6& K_inv = start.K_inv[i] = inverse_stiffness(coupling, period);
    // K_eff⁻¹ (B/T) e_prev: the part of the last offset that the coupling's damper still holds.
    const double lag = coupling.damping_time / (period + coupling.damping_time);
    Vec6 held = lag * last_offset[i], offset = last_offset[i];
    for (int c = 0; c < 6; ++c)
      if (K_inv[c] == 0) held[c] = offset[c] = 0;
    start.X_free[i] = displaced(X_device[i], K_inv.cwiseProduct(problem.instrument[i].load) - held);
    start.X_start[i] = displaced(X_device[i], -offset);
  }
  return start;
}

EachInstrument<Vec6> coupling_offset(const InstrumentPoses& X_device, const InstrumentPoses& X_instrument,
                                     const EachInstrument<Vec6>& K_inv) noexcept {
  EachInstrument<Vec6> offset = difference(X_device, X_instrument);
  for (int i = 0; i < max_instruments; ++i)
    for (int c = 0; c < 6; ++c)
      if (K_inv[i][c] == 0) offset[i][c] = 0;
  return offset;
}

InstrumentPoses placed_by(const CouplingStart& start, const EachInstrument<Vec6>& wrench) noexcept {
  InstrumentPoses X = start.X_free;
  for (int i = 0; i < max_instruments; ++i)
    if (X.present[i]) X[i] = displaced(start.X_free[i], start.K_inv[i].cwiseProduct(wrench[i]));
  return X;
}

}  // namespace hapticd
