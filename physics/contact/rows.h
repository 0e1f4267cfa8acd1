// Contact rows from a patch and an instrument pose: the pure function both loops share.
//
//   H_i = Fᵢᵀ Σ_a w_a E_a,   J_i = −Fᵢᵀ [I, −(s − p)×],   F = [n t₁ t₂]
//   δ_n,free = gap(s; X_lin) + n·(s_free − s) + J_n (X_free ⊖ X_lin)
//   δ_t,free = Tᵀ(s_free − X_lin·anchor)      + J_t (X_free ⊖ X_lin)
//   W_ij = F_iᵀ (Σ_ab w_a w_b C_ab + B_ij) F_j,   B_ij = K_t⁻¹ − [r_i]× K_r⁻¹ [r_j]×,   r = s − p_lin, of one
//   instrument; 0 of two
//
// s: the sample's position at the linearisation, s_free: without contact. At a fixed point of the
// linearisation δ_n is the true gap and δ_t the true slip. A row is for one sample and one primitive; a
// sample has rows for all primitives within the margin (contact_pairs.h), where the instrument is on the
// outer side of the tissue (`may_press`, missed_contact.h); or, last, for two primitives of two instruments
// (instrument_pairs.h), behind those of blades' edges (edge_rows.h). More candidates than capacity:
// contact_selection.h chooses; overlapping ones that are left out are counted in `dropped`. Friction rows
// exist only where some μ > 0 or there is an edge. A sample that sticks keeps its anchor in the instrument's
// frame; a sliding or new one takes its place of the previous solve, or the linearisation's own. Units: δ in
// m, λ in N, J·twist in m. Guarantee: wait-free, no allocation, under 110 kB of stack; bounded by
// max_patch_samples × primitives and max_contacts × (patch nodes + max_contacts) 3×3 products. Source: the
// paper, eq. (2); Saupin, Duriez and Cotin 2008. Departure: DESIGN's wrench sign, see contact_solve.h.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "physics/contact/condensed_problem.h"
#include "physics/part_times.h"

namespace hapticd {

struct EitherColumns;
class SamplesInReach;

struct ContactRow {
  int sample = -1;  // index into the problem's samples; −1: another instrument, a front or a ring is there
  int instrument = 0;       // a row is known by its sample, this …
  int primitive;            // … and this of it
  int other = -1;           // the instrument that is touched; −1: tissue
  int edge = -1;            // index into the problem's edge samples; −1: not a blade's edge
  bool incision = false;    // it is the instrument's own ring (incision_rows.h): no sample, no other
  std::uint64_t id;         // the sample's id, or one of two primitives (instrument_pairs.h)
  Mat3 frame;               // columns n, t1, t2 (world)
  Vec3 arm;                 // s − p_instrument [m]
  Vec3 other_arm;           // … of the other
  Vec3 anchor;              // instrument's frame: slip is measured from here [m]
  Vec3 other_anchor;        // … to here, in the other's
  Vec3 delta_free;          // [m]: normal, then two tangential (0 where frictionless)
  double gap;               // true signed distance at the linearisation [m]
  double friction;          // μ
  double limit = no_limit;  // of λ_n; finite at edges alone [N]
  double advance = 0;       // of an edge: the total it counts from; of an incision: its play [m]
  double compliance = 0;    // of the row itself, in W_nn of a viscous edge, in W_ii of an incision [m/N]
};

// Rows per contact: 1 (frictionless: row i is contact i) or 3 (rows 3i, 3i+1, 3i+2).
struct ContactRows {
  int contacts = 0;
  int rows_per_contact = 1;
  int edges = 0;    // of them, of blades' edges
  int dropped = 0;  // overlapping candidates beyond capacity
  std::array<ContactRow, max_contacts> row;
  std::array<double, std::size_t(max_rows) * max_rows> W_storage;  // column-major, ld = rows()
  std::array<double, max_rows> q_storage;                          // δ_free

  int rows() const noexcept { return contacts * rows_per_contact; }
  Eigen::Map<MatX> W() noexcept { return {W_storage.data(), rows(), rows()}; }
  Eigen::Map<const MatX> W() const noexcept { return {W_storage.data(), rows(), rows()}; }
  Eigen::Map<VecX> q() noexcept { return {q_storage.data(), rows()}; }
  Eigen::Map<const VecX> q() const noexcept { return {q_storage.data(), rows()}; }
};

// Positions of the patch's nodes that rows are linearised at (x_free to begin with).
using PatchPositions = std::array<Vec3, max_patch_nodes>;

// Where an earlier solve took patch and instruments.
struct Reached {
  const PatchPositions& x;
  InstrumentPoses X;
  int most_new = max_patch_samples;  // rows with friction, of what it let through
};

// Whether a sample that bore force is gone: its face was removed.
bool forgets(const CondensedProblem& problem, const ContactMemory& memory) noexcept;

// Patch nodes that a row's place is the weighted sum of, and that its force is spread over; none of an
// obstacle and of another instrument.
struct NodeWeights {
  std::span<const std::int32_t> node;
  std::span<const double> weight;
};
NodeWeights node_weights(const CondensedProblem& problem, const ContactRow& row) noexcept;
NodeWeights node_weights(const PatchSample& sample) noexcept;

// Place of a sample when the patch's nodes are at x.
Vec3 sample_position(const CondensedProblem& problem, const PatchPositions& x, int sample) noexcept;

// Columns n, t1, t2, right-handed; a function of n alone, smooth but across n_z = 0 (Duff et al. 2017).
// Friction is isotropic: no result depends on the choice.
Mat3 contact_frame(const Vec3& n) noexcept;

// Selects contacts and fills `rows` with frames, δ_free and W for the instruments' free poses X_free
// (device pose, plus the coupling's memory) and for their linearisation poses X_lin, which say who is
// present; K_inv_diag = diagonal of K_eff⁻¹ (3 translational, 3 rotational) in world axes; samples whose gap
// at the linearisation is below `margin` become rows; with `reached` those too that an earlier solve of fewer
// rows, at the same linearisation, took through an instrument (linearised gap there < 0). period: of the
// solve, for viscous edges [s]. columns: without edges, begun instead of making all of W.
// in_reach: of the problem's samples, kept by the caller.
void build_rows(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X_free,
                const InstrumentPoses& X_lin, const PatchPositions& x_lin,
                const EachInstrument<Vec6>& K_inv_diag, const ContactMemory& memory, double margin,
                ContactRows& rows, const Reached* reached = nullptr, PartTimes* times = nullptr,
                double period = 0, EitherColumns* columns = nullptr,
                SamplesInReach* in_reach = nullptr) noexcept;

// q of rows frozen at X_frozen (built with X_free = X_lin = X_frozen) for other free poses:
// δ_free(X) = δ_free + J (X ⊖ X_frozen). Tangential rows take their slip since the memory's anchors.
void shift_rows(const CondensedProblem& problem, const InstrumentPoses& X_frozen,
                const InstrumentPoses& X_free, const ContactMemory& memory, ContactRows& rows) noexcept;

// The 6-row transpose product: wrench on each instrument = Jᵀ λ (force, torque about its origin).
EachInstrument<Vec6> wrench_on_instruments(const ContactRows& rows, std::span<const double> lambda) noexcept;

// Positions under contact: x = x_free + C_pp Hᵀ λ.
void displaced_patch(const CondensedProblem& problem, const ContactRows& rows, std::span<const double> lambda,
                     PatchPositions& x) noexcept;

// The same for the forces of a previous solve, found by sample id; x = x_now where there are none or one of
// them is forgotten, for without it what it held would spring through the instrument.
void displaced_patch(const CondensedProblem& problem, const ContactMemory& memory,
                     PatchPositions& x) noexcept;

}  // namespace hapticd
