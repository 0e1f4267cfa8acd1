// One contact solve at the devices' poses: linearise, solve, renew, solve again. Both loops call it.
//
//   repeat `linearisations` times, or until forces hardly turn (`turned`), or while a sample is `too_deep`:
//     rows at (X_lin, x) → λ → x = x_free + C_pp Hᵀ λ,  X_instrument = X_free ⊕ K_eff⁻¹ Jᵀ λ = next X_lin
//   virtual coupling, massless proxy, e = X_device ⊖ X_instrument:  K e + B (e − e_prev)/T + Jᵀλ = 0,
//     K_eff = K + B/T;  a stiffness of zero means held rigidly (K⁻¹ = 0, no lag)
//   wrench on the device = Jᵀ λ,  J = ∂δ/∂twist of the instrument (DESIGN writes −Jᵀλ for the opposite J)
//
// The first linearisation is at the last solve's forces and coupling offset, found again by sample id and
// primitive, else at x_now (rows.h). If the solution violates a sample that has no row, that sample becomes a
// row and the problem is solved again, at most eight times (missed_contact.h).
// Renewal::frozen: rows once at problem.X_ref and x_now, one solve, as in the paper; renewed: in each
// linearisation. Friction: a contact that sticks keeps its anchor, one that slides takes a new one. A solve
// that ended unusable is resumed by the next tick (`near`: the wrench is right to some percent). Nothing is
// linearised about an unusable solve. Units: N, N·m. Errors: by status; after `not_finite` force and memory
// are zero and the proxy is at the free pose; a linearisation without time is left out, and the status says
// so. Guarantee: no allocation, wait-free, bounded by 9 (linearisations + 3) × (rows + solver); 128 kB of
// stack. Source: Saupin, Duriez and Cotin 2008 (multi-rate); Alart and Curnier 1991; de Saxcé and Feng 1998.
#pragma once

#include "physics/contact/candidates/samples_in_reach.h"
#include "physics/contact/delassus_columns.h"
#include "physics/contact/rows.h"
#include "physics/contact/solver/coulomb.h"
#include "physics/contact/virtual_coupling.h"

namespace hapticd {

struct ContactOptions {
  int linearisations = 2;
  // Later ones are left out once forces, weighted by their size, turn by less in a solve, and gaps are true;
  // 0: never [rad].
  double turned = 0;
  // … and up to three more follow while a sample ends deeper [m]; not `solved` if time ends them. 0: none.
  double too_deep = 0;
  // Gap below which a sample is held to the contact's law [m]; 0: the problem's alarm distance.
  double margin = 0;
  // Gap below which it becomes a row at once; one between the two when a solve without it would let it
  // through: fewer rows, the same solution (missed_contact.h) [m]. 0: margin.
  double activation_distance = 0;
  // Rows with friction that each repeated solve adds at most, of what the last one let through.
  int most_new = max_patch_samples;
  LcpOptions lcp;
  CoulombOptions coulomb;
  // A solve that ended at a cap with a larger residual leaves memory and coupling as they were, unless
  // resumed.
  double usable_residual = std::numeric_limits<double>::infinity();
  // Problems of one number have the same samples: what is in reach of them is kept from solve to solve.
  bool numbered = false;
  bool whole_W = false;  // for who reads it in the scratch: else it may lack columns that no force asked for
  Deadline deadline;     // of the whole solve; the linearisations to come have what the first one leaves
  PartTimes* times = nullptr;
  double parts = 1;  // that the period's way is solved in, of which this is one: viscous edges have T/parts
};

// Carried from one solve to the next by its owner; each loop has its own, with its own scratch: a frozen
// state's rows live in that scratch.
struct ContactState {
  ContactMemory memory;
  EachInstrument<Vec6> coupling_offset;  // e_prev: X_device ⊖ X_instrument
  std::uint64_t frozen_step = 0;         // step whose rows `scratch.rows` hold (frozen renewal) …
  EachInstrument<bool> frozen_present;   // … and of whom
  int resumed = 0;                       // solves still to come that resume the last one
};

struct ContactScratch {
  ContactRows rows;
  std::uint64_t matrix_version = 0;  // counts W's; 0: rows hold none yet
  ContactMemory working;             // λ and anchors between the linearisations of one solve
  ContactMemory kept;                // of the last linearisation that ended usable
  SamplesInReach in_reach;
  EitherColumns columns;
  bool on_demand = false;  // rows.W() is made by `columns`
  LcpWorkspace lcp;
  CoulombWorkspace coulomb;
  PatchPositions x;
  std::array<double, max_rows> resumed_lambda{};
  std::array<double, max_contacts> normal_q{}, normal_lambda{};
  std::array<double, std::size_t(max_contacts) * max_contacts> normal_W{};  // column-major, ld = contacts
  std::array<double, max_rows> lambda{};
  std::array<std::uint8_t, max_rows> active{};
  std::array<double, max_contacts> mu{};
  std::array<double, max_contacts> limit{};
};

struct ContactSolution {
  SolveStatus status = SolveStatus::solved;
  EachInstrument<Vec6>
      wrench;  // on the device, loads too, scene units: force [N], torque about its origin [N·m]
  InstrumentPoses instrument;  // proxy poses under contact
  int contacts = 0;            // rows considered
  int active = 0;              // with λ_n > 0
  int dropped = 0;
  bool near = false;       // turns got on: the wrench is near, whatever the residual
  bool laboured = false;   // resumed, and solved by more than its turns
  double residual = 0;     // of the last solve, natural map
  double penetration = 0;  // deepest true overlap left after the solve, of any sample [m], ≥ 0
  double lost = 0;         // … of those that no row holds
};

// period: T of the caller [s]. λ per contact of the solution is in scratch.lambda, rows in scratch.rows,
// patch positions under contact in scratch.x.
ContactSolution solve_contact(const CondensedProblem& problem, Instruments instruments,
                              const InstrumentPoses& X_device, double period, const ContactOptions& options,
                              ContactState& state, ContactScratch& scratch) noexcept;

}  // namespace hapticd
