// One contact solve at a device pose: linearise, solve, renew, solve again. Both loops call it.
//
//   repeat `linearisations` times: rows at (X, x) → λ → x = x_free + C_pp Hᵀ λ, X_instrument = X_free ⊕ K_eff⁻¹ Jᵀ λ
//
// Virtual coupling with a massless proxy: e = X_device ⊖ X_instrument,
//   K e + B (e − e_prev)/T + Jᵀλ = 0  ⇒  e = K_eff⁻¹ (B/T e_prev − Jᵀ λ),  K_eff = K + B/T,
// so the coupling enters W as J K_eff⁻¹ Jᵀ and the free instrument pose is X_device ⊖ K_eff⁻¹ (B/T) e_prev.
// Wrench on the device = Jᵀ λ (N, N·m; J = ∂δ/∂twist of the instrument, so virtual work fixes the
// sign; DESIGN writes −Jᵀλ for the opposite J).
// Renewal::frozen: rows are built once at problem.X_ref (when the step changes) and only δ_free moves
// with the pose, as in the paper. Renewal::renewed: geometry is renewed in each linearisation.
// Guarantee: no allocation, wait-free, bounded by linearisations × (rows + solver's bound).
#pragma once

#include "physics/contact/coulomb.h"
#include "physics/contact/rows.h"

namespace hapticd {

struct ContactOptions {
  int linearisations = 2;
  double margin = 0;  // gap below which a sample becomes a row [m]; 0: the problem's alarm distance
  LcpOptions lcp;
  CoulombOptions coulomb;
};

// Carried from one solve to the next by its owner; each loop has its own.
struct ContactState {
  ContactMemory memory;
  Vec6 coupling_offset = Vec6::Zero();  // e_prev: X_device ⊖ X_instrument
  std::uint64_t frozen_step = 0;        // step whose rows `scratch.rows` hold (frozen renewal)
};

struct ContactScratch {
  ContactRows rows;
  LcpWorkspace lcp;
  PatchPositions x;
  std::array<double, max_rows> lambda{};
  std::array<std::uint8_t, max_rows> active{};
  std::array<double, max_contacts> mu{};
  std::array<Mat3, max_contacts> frozen_frame;
};

struct ContactSolution {
  SolveStatus status = SolveStatus::solved;
  Vec6 wrench = Vec6::Zero();   // on the device, scene units: force [N], torque about its origin [N·m]
  Pose instrument;              // proxy pose under contact
  int contacts = 0;             // rows considered
  int active = 0;               // with λ_n > 0
  int dropped = 0;
  double residual = 0;          // of the last solve, natural map
  double penetration = 0;       // deepest true overlap left after the solve [m], ≥ 0
};

// period: T of the caller [s]. λ per contact of the solution is in scratch.lambda, rows in scratch.rows,
// patch positions under contact in scratch.x.
ContactSolution solve_contact(const CondensedProblem& problem, const Instrument& instrument,
                              const Pose& X_device, double period, const ContactOptions& options,
                              ContactState& state, ContactScratch& scratch) noexcept;

}  // namespace hapticd
