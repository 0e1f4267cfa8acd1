// One contact solve at a device pose: linearise, solve, renew, solve again. Both loops call it.
//
//   repeat `linearisations` times:
//     rows at (X_lin, x) → λ → x = x_free + C_pp Hᵀ λ,  X_instrument = X_free ⊕ K_eff⁻¹ Jᵀ λ = next X_lin
//
// The first linearisation is at the last solve's forces and coupling offset, found again by sample id; where
// none is known, or a sample is gone, at x_now (rows.h). What no row holds may spring through the instrument,
// where normals point out on its wrong side: a solve that leaves a sample deeper than `margin`, or at all
// inside of those that were nearer than `margin`, is repeated at its own linearisation, with the samples that
// it let through as rows too, at most three times.
// Virtual coupling with a massless proxy: e = X_device ⊖ X_instrument,
//   K e + B (e − e_prev)/T + Jᵀλ = 0  ⇒  e = K_eff⁻¹ (B/T e_prev − Jᵀ λ),  K_eff = K + B/T,
// so the coupling enters W as J K_eff⁻¹ Jᵀ and the free instrument pose is X_device ⊖ K_eff⁻¹ (B/T) e_prev.
// Wrench on the device = Jᵀ λ (N, N·m; J = ∂δ/∂twist of the instrument, so virtual work fixes the
// sign; DESIGN writes −Jᵀλ for the opposite J).
// A stiffness of zero means held rigidly (K⁻¹ = 0, no lag), in translation or rotation.
// Renewal::frozen: rows are built once at problem.X_ref and x_now (when the step changes) and only δ_free
// moves with the pose, as in the paper; one solve. Renewal::renewed: geometry is renewed in each
// linearisation.
// Friction memory: a contact that sticks keeps its anchor, so that holding still cannot creep; one that
// slides or is open takes the place where the solve left it. Sticking is judged by slip, ‖δ_t‖ ≤
// 1e-6 · tr W_ii/3 · ‖λ_i‖, or by λ being inside its cone; a slip below that adds up until it shows.
// Resumed solves: where one with friction ends at a cap or its deadline, Newton's unfinished steps may be
// anything, and it would end there again in the next tick. So until turns alone solve one, or 200 were usable,
// solves have one linearisation and take turns of what nears the solution from wherever it starts: normal forces
// for the friction there is (lcp.h), then sweeps; with time left, the whole solver. What they reach is
// remembered, usable or not, and `near`: the wrench is right to some percent long before the residual is.
// Deadline: a linearisation that it leaves no time for is left out, and the status says so.
// Errors: by status; after `not_finite` force and memory are zero and the proxy is at the free pose.
// Guarantee: no allocation, wait-free, bounded by 4 linearisations × (rows + solver's bound); 128 kB of
// stack.
// Source: Saupin, Duriez and Cotin 2008 (multi-rate); Alart and Curnier 1991; de Saxcé and Feng 1998.
#pragma once

#include "physics/contact/rows.h"
#include "physics/contact/solver/coulomb.h"

namespace hapticd {

struct ContactOptions {
  int linearisations = 2;
  // Gap below which a sample is held to the contact's law [m]; 0: the problem's alarm distance.
  double margin = 0;
  // Gap below which it becomes a row at once; one between the two when a solve without it would let it
  // through: fewer rows, the same solution (missed_contact.h) [m]. 0: margin.
  double activation_distance = 0;
  LcpOptions lcp;
  CoulombOptions coulomb;
  // A solve that ended at a cap with a larger residual leaves memory and coupling as they were, unless resumed.
  double usable_residual = std::numeric_limits<double>::infinity();
  Deadline deadline;  // of the whole solve; half of what is left is kept for the linearisations to come
  PartTimes* times = nullptr;
};

// Carried from one solve to the next by its owner; each loop has its own, with its own scratch: a frozen
// state's rows live in that scratch.
struct ContactState {
  ContactMemory memory;
  Vec6 coupling_offset = Vec6::Zero();  // e_prev: X_device ⊖ X_instrument
  std::uint64_t frozen_step = 0;        // step whose rows `scratch.rows` hold (frozen renewal)
  int resumed = 0;                      // solves still to come that resume the last one
};

struct ContactScratch {
  ContactRows rows;
  std::uint64_t matrix_version = 0;  // counts W's; 0: rows hold none yet
  ContactMemory working;             // λ and anchors between the linearisations of one solve
  LcpWorkspace lcp;
  CoulombWorkspace coulomb;
  PatchPositions x;
  std::array<double, max_rows> resumed_lambda{};
  std::array<double, max_contacts> normal_q{}, normal_lambda{};
  std::array<double, std::size_t(max_contacts) * max_contacts> normal_W{};  // column-major, ld = contacts
  std::array<double, max_rows> lambda{};
  std::array<std::uint8_t, max_rows> active{};
  std::array<double, max_contacts> mu{};
};

struct ContactSolution {
  SolveStatus status = SolveStatus::solved;
  Vec6 wrench = Vec6::Zero();  // on the device, scene units: force [N], torque about its origin [N·m]
  Pose instrument;             // proxy pose under contact
  int contacts = 0;            // rows considered
  int active = 0;              // with λ_n > 0
  int dropped = 0;
  bool near = false;       // of a resumed solve that got on: the wrench is near, whatever the residual
  bool laboured = false;   // resumed, and solved by more than its turns
  double residual = 0;     // of the last solve, natural map
  double penetration = 0;  // deepest true overlap left after the solve, of any sample [m], ≥ 0
  double lost = 0;         // … of those that no row holds
};

// K_eff⁻¹ = (K (1 + damping_time/T))⁻¹, diagonal in world axes; zero where K is zero.
Vec6 inverse_stiffness(const VirtualCoupling& coupling, double period) noexcept;

// period: T of the caller [s]. λ per contact of the solution is in scratch.lambda, rows in scratch.rows,
// patch positions under contact in scratch.x.
ContactSolution solve_contact(const CondensedProblem& problem, const Instrument& instrument,
                              const Pose& X_device, double period, const ContactOptions& options,
                              ContactState& state, ContactScratch& scratch) noexcept;

}  // namespace hapticd
