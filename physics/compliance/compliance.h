// A body's compliance C = A⁻¹, A = M/h² + B/h + K(u), behind the interface that every method has.
//
//   free motion  Δx_free = C (M v/h + f_ext + f_int(x)),   correction  Δx = Δx_free + C Hᵀλ,
//   patch        C_pp = Eₚᵀ C Eₚ
//
//   const auto compliance = make_compliance(ComplianceMethod::exact, model, h);
//   compliance->move_zone(near_instrument);     // the nodes whose C_pp will be asked for
//   compliance->update(state);                  // A at the state's rotations
//   compliance->apply(b, dx);                   // dx = C b
//   compliance->patch(near_instrument, C_pp);
//   remove_tets(model, state, tets);
//   compliance->remove(state, tets);            // before the next update
//
// Units: A [N/m], C [m/N]; multipliers are newtons for every h. Shapes: vectors of 3·nodes, node-wise
// interleaved; fixed and orphan nodes are identity rows of A, and their entries of every result are zero.
// Errors: `update` throws std::runtime_error when A is not positive definite (a part with neither mass nor
// support); `apply`, `patch` and `report` throw it before a successful update. Threads: nothing here starts
// one, and BLAS should have one (blas_threads.h). Source: the paper, eqs. (2) and (3). Departure: only `lazy`
// treats a removal as the paper does.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "physics/part_times.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

// reference_compliance.h tells which of them keep a reference factor.
enum class ComplianceMethod : std::uint8_t { exact, zone, lazy, updown, dense };

enum class NodeOrder : std::uint8_t { zone_last, metis };

// How the reference factor is turned with the tissue: not; each node by its own turn, as the paper; all nodes
// of a connected piece by the piece's mean turn (warp_rotation.h: what each is good for).
enum class Warping : std::uint8_t { none, node, piece };

// Who factors A for `exact`: our own fronts (multifrontal_factor.h), or CHOLMOD, the oracle and fallback.
enum class Factorisation : std::uint8_t { multifrontal, cholmod };

struct ComplianceOptions {
  double good_error = 1e-6;               // sampled error above it: not `good`
  double reference_error_limit = 0.03;    // … above it: a reference factor is wanted
  double usable_error = 0.1;              // … above it: degraded
  double reference_rotation_limit = 0.5;  // largest `rotation_since_reference` that is left alone
  int reference_age_limit = 1000;         // updates since the reference factor that are left alone
  int reference_removed_limit = 64;       // removals carried over as low-rank terms that are left alone
  int most_carried = 256;                 // zone: what goes beyond them waits for the next reference factor
  int most_appended = 128;  // zone: nodes that cuts may append to the corner; beyond it the corner still
                            // grows, but allocates. A reference factor is wanted from half of it on
  int most_taken_in = 160;  // zone: nodes from outside that may join it; a reference factor is wanted from an
                            // eighth of it on. Cuts take in what they must
  bool synchronous_reference = true;  // zone: `update` then makes it, late; false: somebody else does
  bool quantised_reference = false;   // zone: solve with a rounded copy of it (leading_columns.h)
  int lazy_reference_after = 0;       // lazy: removals until `update` makes a new one; 0: never, as the paper
  NodeOrder updown_order = NodeOrder::zone_last;
  Factorisation factorisation = Factorisation::multifrontal;  // exact
  int sample_every = 1;                                       // updates between two samples of the error
  std::optional<Warping> warping;  // default: zone by piece; lazy, updown and dense by node, as the paper
  PartTimes* times = nullptr;      // of the step it is part of: `update` tells assembly from factor
};

// good: the sampled error is below `good_error`, and nothing has moved since the sample.
// new_reference_wanted: usable, and not proven better. degraded: the error is above `usable_error`, or the
// reference factor failed.
enum class ComplianceHealth : std::uint8_t { good, new_reference_wanted, degraded };

// Of the last update; residual and error of the last sample, 0 while a new reference factor has none (never
// `good` then).
struct ComplianceReport {
  ComplianceHealth health = ComplianceHealth::good;
  bool wants_reference = false;  // degraded, or a new one is due by error, rotation, age or what is carried
  double residual = 0;  // ‖A y − b‖/‖b‖ of one sampled solve y = C b, against the true A(u)
  double error = 0;     // ‖C (A y − b)‖/‖y‖, what one step of refinement would still change
  int removed_since_reference = 0;
  int appended_since_reference = 0;  // nodes that cuts have appended to the corner: zone alone
  int taken_in_since_reference = 0;  // nodes from outside that joined it: zone alone
  int reference_age = 0;             // updates since the reference factor was made
  double rotation_since_reference =
      0;                         // largest in the zone, beyond its piece's own where that is undone [rad]
  std::size_t memory_bytes = 0;  // of factor, inverse and terms
};

class Compliance {
 public:
  virtual ~Compliance() = default;

  // The zone wanted: of the next `update` (exact, updown), or of the next reference factor. Fixed nodes are
  // allowed and ignored. Patches of the nodes named first are the cheapest: name the nearest first.
  // Throws std::invalid_argument for a node that the model has not.
  virtual void move_zone(std::span<const int> nodes) = 0;

  // True if the zone in use has every free node of `nodes`. With exact and zone that is the last factor's, or
  // the zone wanted before there is a factor; others cost `patch` a half solve each. With lazy and updown it
  // is the zone wanted. dense has all nodes.
  [[nodiscard]] virtual bool zone_covers(std::span<const int> nodes) const = 0;

  // Pre: these tetrahedra just went, and are dead in `after`. An `update` must follow before any use.
  virtual void remove(const TissueState& after, std::span<const int> tets) = 0;

  // Pre: a cut just changed the corners of these live tetrahedra, or took them into use
  // (TissueModel::parent); the model and `after` are as they are now. An `update` must follow before any use.
  virtual void reshape(const TissueState& after, std::span<const int> tets);

  // Post: C is the method's inverse of A at the state's rotations, live tetrahedra only.
  virtual void update(const TissueState& state) = 0;

  // Post: y = C b (both of 3·nodes entries; may alias).
  virtual void apply(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) = 0;

  // Pre: with lazy and updown zone_covers(nodes) at the last update; std::invalid_argument otherwise. Post:
  // `block`, 3·|nodes| square, is C_pp of these nodes; rows of fixed or orphan nodes are zero.
  virtual void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) = 0;

  [[nodiscard]] virtual ComplianceReport report() = 0;
};

// Of any method. The model must outlive the compliance. std::invalid_argument: h ≤ 0.
[[nodiscard]] std::unique_ptr<Compliance> make_compliance(ComplianceMethod method, const TissueModel& model,
                                                          double h, const ComplianceOptions& options = {});

// … of what is simulated of a body whose rest is condensed (near_compliance.h), and goes with the compliance.
// zone: by the submodel's numbers; with any, a method that keeps a reference factor has one of the submodel's
// state and that zone.
struct Submodel;
[[nodiscard]] std::unique_ptr<Compliance> make_compliance(ComplianceMethod method,
                                                          std::unique_ptr<Submodel> near, double h,
                                                          const ComplianceOptions& options = {},
                                                          std::span<const int> zone = {});

// A refactorisation each step: the model of accuracy. Of a linear body only where elements went or the zone
// moved.
[[nodiscard]] std::unique_ptr<Compliance> make_exact_compliance(const TissueModel& model, double h,
                                                                const ComplianceOptions& options = {});

}  // namespace hapticd
