// The condensed contact problem: what the simulation publishes and the haptic thread re-solves.
//
//   δ = W λ + δ_free,   W = H C_pp Hᵀ + Σ_i J_i K_i⁻¹ J_iᵀ,   0 ≤ δ_n ⟂ λ_n ≥ 0,   ‖λ_t‖ ≤ μ λ_n
//
// It carries the *patch* of tissue surface within the instruments' reach: patch nodes, the
// compliance C_pp between them, their free positions (where they would be at the end of the step
// without contact) and present positions, and fixed material sample points on the patch's triangles.
// A blade's edge samples are beside them (edge_sample.h). Rows H, J are built from it by `build_rows`
// (rows.h), the same pure function on either side.
//
// Units: m, N, m/N. Shapes: C_pp is (3·nodes)×(3·nodes), column-major, node-wise interleaved x,y,z,
// leading dimension `3 * nodes`. Fixed capacity: this is a plain value of ~3 MB that is written in
// place in a channel slot; no heap, and no pointer but to a C_pp that is lent (`lend`).
// Source: the paper, eq. (2) and Fig. 2; departure: the paper publishes rows frozen for a step, here
// they can be renewed each haptic tick (`Renewal`).
#pragma once

#include <array>
#include <cstdint>

#include "physics/contact/contact_memory.h"
#include "physics/contact/cutting/edge_sample.h"
#include "physics/contact/instruments.h"
#include "physics/types.h"

namespace hapticd {

inline constexpr int max_patch_nodes = 192;
inline constexpr int max_nodes_of_instrument = 96;  // of them, that one instrument fills
inline constexpr int max_patch_samples = 2048;
inline constexpr int max_rows = 3 * max_contacts;

// Who rebuilds contact geometry: nobody within the step (the paper), or every solve.
enum class Renewal : std::uint8_t { frozen, renewed };

// A fixed material point of a body's surface: position = Σ weight[a] · patch node[a],
// or `free` itself for a rigid obstacle (node[0] < 0).
struct PatchSample {
  std::uint64_t id;                  // body, face and point in face: stable between steps
  std::array<std::int32_t, 3> node;  // into the patch's nodes; −1: fixed obstacle
  std::array<double, 3> weight;      // barycentric, sums to 1
  Vec3 free;                         // fixed obstacle: its place; else unused [m]
  Vec3 outward;                      // outward unit normal of the tissue at the sample, at x_now
  double friction;                   // Coulomb μ against the instrument; 0: frictionless
};

// 6-DoF virtual coupling between device and (massless) instrument; diagonal in world axes.
//   W gets J K_eff⁻¹ Jᵀ with K_eff = K + B/T, B = damping_time · K   (T the caller's period)
struct VirtualCoupling {
  double stiffness = 0;             // [N/m]
  double rotational_stiffness = 0;  // [N·m/rad]
  double damping_time = 0;          // B/K [s]
};

// One instrument, as the problem was made.
struct InstrumentReference {
  Pose X_ref;  // the patch was gathered (and rows frozen) at
  VirtualCoupling coupling;
  Vec6 load = Vec6::Zero();  // a wrench on it beside contact's: of suction, about its origin
  Vec6 way =
      Vec6::Zero();  // … and how it moves from where x_now was, if it has one: what it holds goes with it
  Vec6 offset = Vec6::Zero();  // X_device ⊖ X_instrument after the solve that `known` is of
};

constexpr std::array<double, max_patch_nodes> all_nodes(double value) noexcept {
  std::array<double, max_patch_nodes> all{};
  for (double& of : all) of = value;
  return all;
}

struct CondensedProblem {
  std::uint64_t step = 0;         // number of the publication, one to four a simulation step; 0: none yet
  std::int64_t published_ns = 0;  // CLOCK_MONOTONIC at publication, set by the publisher
  EachInstrument<InstrumentReference> instrument;
  Renewal renewal = Renewal::renewed;
  bool topology_changed = false;   // elements were removed since the previous problem
  bool thinned = false;            // … or some became less (removal by degrees)
  bool known_sound = false;        // its publisher looked (haptic/contact/problem_check.h)
  double alarm_distance = 0;       // rows exist for gaps below this [m]
  double instrument_friction = 0;  // Coulomb μ between two instruments

  int nodes = 0;
  int samples = 0;
  int edges = 0;
  int dropped_samples = 0;                   // did not fit max_patch_samples (nearest are kept)
  std::array<Vec3, max_patch_nodes> x_free;  // [m]
  std::array<Vec3, max_patch_nodes>
      x_now;                               // at the begin of the step, or where an interim problem begins [m]
  std::array<Vec3, max_patch_nodes> pull;  // of suction, in x_free [N]
  std::array<PatchSample, max_patch_samples> sample;  // sorted by id
  std::array<EdgeSample, max_edge_samples> edge;      // sorted by id
  ContactMemory known;  // the simulation's last contact: what a haptic loop that begins anew takes
  // C_pp and what each node's columns of it are to be taken times: 1, but in a tick's own problem.
  std::array<double, std::size_t(9) * max_patch_nodes * max_patch_nodes> C_pp;  // [m/N]
  std::array<double, max_patch_nodes> column_scale = all_nodes(1);
  const CondensedProblem* lender = nullptr;  // whose C_pp this one has; null: its own

  Eigen::Map<const MatX> C() const noexcept {
    return {(lender ? lender : this)->C_pp.data(), 3 * nodes, 3 * nodes};
  }
  // For writing: a C_pp that is lent is copied first. To read it, take the const one.
  Eigen::Map<MatX> C() noexcept {
    if (lender) keep_own_compliance();
    return {C_pp.data(), 3 * nodes, 3 * nodes};
  }
  void keep_own_compliance() noexcept;
};

// Whether suction loads an instrument.
inline bool is_pulled(const CondensedProblem& problem) noexcept {
  for (const InstrumentReference& of : problem.instrument.value)
    if (!of.load.isZero(0)) return true;
  return false;
}

// C_pp with its columns' scale in it.
void fold_scale(CondensedProblem& problem) noexcept;

// The parts of a problem that are in use. The copy is not `known_sound`.
void copy_in_use(const CondensedProblem& from, CondensedProblem& to) noexcept;

// The same without C_pp, which is most of it: that is read where it is. Pre: `from` has a C_pp
// of its own, and stays as it is while that of `to` is read.
void lend(const CondensedProblem& from, CondensedProblem& to) noexcept;

}  // namespace hapticd
