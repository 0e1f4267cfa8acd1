// A body's compliance C = A⁻¹, A = M/h² + B/h + K(u), behind one small interface.
//
//   free motion  Δx_free = C (M v/h + f_ext + f_int(x)),   correction  Δx = Δx_free + C Hᵀλ,
//   patch        C_pp = Eₚᵀ C Eₚ
//
// The nodes near the instrument (the zone) are ordered last, so that C_pp comes from the factor's
// trailing dense corner: L_zz L_zzᵀ = A_zz − A_zr A_rr⁻¹ A_rz.
// Methods that keep a reference factor (a factor or an inverse of an earlier A) say after each update how far
// they are from the present A, and when they want a new reference factor; the reference factor can be made
// elsewhere, on any one thread, and adopted between two steps. Nothing here starts a thread. Units: A [N/m],
// C [m/N]; multipliers are newtons for every h. Shapes: vectors of 3·nodes, node-wise interleaved; fixed and
// orphan nodes are identity rows: their entries of every result are zero. Errors: `update` throws
// std::runtime_error when A is not positive definite (a singular model: no mass and no support); `apply`,
// `patch` and `report` throw it before a successful update. Source: the paper, eqs. (2) and (3). Departure:
// only `lazy` treats a removal as the paper does.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "physics/part_times.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

enum class ComplianceMethod : std::uint8_t { exact, zone, lazy, updown, dense };

enum class NodeOrder : std::uint8_t { zone_last, metis };

// How the reference factor is turned with the tissue: not; each node by its own turn, as the paper; all nodes
// of a connected piece by the piece's mean turn (warp_rotation.h: what each is good for).
enum class Warping : std::uint8_t { none, node, piece };

// Who factors A for `exact`: our own fronts (multifrontal_factor.h), or CHOLMOD, the oracle and fallback.
enum class Factorisation : std::uint8_t { multifrontal, cholmod };

struct ComplianceOptions {
  double good_error = 1e-6;        // sampled error above it: not `good`
  double reference_error_limit = 0.03;  // … above it: a reference factor is wanted
  double usable_error = 0.1;       // … above it: degraded
  double reference_rotation_limit = 0.5;  // largest `rotation_since_reference` that is left alone
  int reference_age_limit = 1000;         // updates since the reference factor that are left alone
  int reference_removed_limit = 64;       // removals carried over as low-rank terms that are left alone
  int most_carried = 256;  // zone: more of them are not carried, but wait for the next reference factor
  bool synchronous_reference =
      true;                        // zone: which `update` then makes itself, late; false: somebody else does
  int sample_every = 1;            // updates between two samples of the error
  std::optional<Warping> warping;  // default: zone by piece; lazy, updown and dense by node, as the paper
  bool quantised_reference =
      false;  // zone: solve with a rounded copy of the reference factor (leading_columns.h)
  NodeOrder updown_order = NodeOrder::zone_last;
  Factorisation factorisation = Factorisation::multifrontal;
  int lazy_reference_after =
      0;  // lazy: removals after which `update` makes a new reference factor; 0: never, as the paper
  PartTimes* times = nullptr;  // of the step it is part of: `update` tells assembly from factor
};

// good: the sampled error is below `good_error`, and nothing has moved since the sample.
// new_reference_wanted: usable, and not proven better. degraded: the error is above `usable_error`, or the
// reference factor failed.
enum class ComplianceHealth : std::uint8_t { good, new_reference_wanted, degraded };

// Of the last update; residual and error of the last sample, 0 while a new reference factor has none (never
// `good` then).
struct ComplianceReport {
  ComplianceHealth health = ComplianceHealth::good;
  bool wants_reference =
      false;  // degraded, or a new reference factor is due by error, rotation, age or what is carried
  double residual = 0;      // ‖A y − b‖/‖b‖ of one sampled solve y = C b, against the true A(u)
  double error = 0;         // ‖C (A y − b)‖/‖y‖, what one step of refinement would still change
  int removed_since_reference = 0;
  int reference_age = 0;  // updates since the reference factor was made
  double rotation_since_reference =
      0;  // largest of a node in the zone, beyond its piece's own where that is undone [rad]
  std::size_t memory_bytes = 0;  // of factor, inverse and terms
};

// A reference factor under way: `make` is the expensive part. It may run on any one thread and touches
// nothing of the compliance that gave it out, nor of the model or the state. Throws std::runtime_error only.
class ReferenceFactor {
 public:
  virtual ~ReferenceFactor() = default;
  virtual void make() = 0;
};

class Compliance {
 public:
  virtual ~Compliance() = default;

  // The zone wanted: of the next `update` (exact, updown), or of the next reference factor. Fixed nodes are
  // allowed and ignored. Patches of the nodes named first are the cheapest: name the nearest first.
  virtual void move_zone(std::span<const int> nodes) = 0;

  // Nodes next to the zone wanted of the next reference factor: out of it, but their patches are not to be
  // dear.
  virtual void move_halo(std::span<const int> nodes) { static_cast<void>(nodes); }

  // True if `patch` will give every free node of `nodes` after the next `update`.
  virtual bool zone_covers(std::span<const int> nodes) const = 0;

  // Tells that these tetrahedra just went; they are already dead in `after`. Before the next `update`.
  virtual void remove(const TissueState& after, std::span<const int> tets) {
    static_cast<void>(after);
    static_cast<void>(tets);
  }

  // Follows A to the state's rotations, live tetrahedra only.
  virtual void update(const TissueState& state) = 0;

  // y = C b (b and y of 3·nodes entries; may alias).
  virtual void apply(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) = 0;

  // The same in halves, for b that is known before a force near the zone is, f: y = C b where `halves_cover`
  // and zero elsewhere; then y = C (b + f). True: there are no halves, y is C b everywhere, and nothing to
  // finish. An update, a removal or a new reference factor in between ends it, and `finish` throws.
  virtual bool begin(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) {
    apply(b, y);
    return true;
  }
  virtual void finish(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y);

  // True if the halves know of every free node of `nodes`: those of the zone, and of the halo.
  virtual bool halves_cover(std::span<const int> nodes) const { return zone_covers(nodes); }

  // y = C f on the zone's nodes, of a force on the zone alone; what y has elsewhere is not promised. Nothing
  // that was begun is ended.
  virtual void apply_in_zone(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) { apply(f, y); }

  // C_pp of the given zone nodes, 3·|nodes| square, into `block` (rows of fixed or orphan nodes are zero).
  // Contract: zone_covers(nodes) at the last update; std::invalid_argument otherwise.
  virtual void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) = 0;

  // ‖C A y − y‖∞/‖y‖∞ with the A of this state: what a step of refinement would change of y. From 1 on, an
  // error like y grows from step to step, as 1 − C A does to it. 0: of a method that keeps no reference
  // factor.
  virtual double disagreement(const TissueState& state, const VecX& y) {
    static_cast<void>(state);
    static_cast<void>(y);
    return 0;
  }

  virtual ComplianceReport report() = 0;

  // What a new reference factor of the present state and the wanted zone needs, to be made elsewhere; null
  // for methods that keep none. Removals told to the compliance after this call are carried over when it is
  // adopted.
  virtual std::unique_ptr<ReferenceFactor> snapshot_reference(const TissueState& state) {
    static_cast<void>(state);
    return nullptr;
  }

  // Takes a made reference factor of this compliance's own `snapshot_reference`; an `update` must follow
  // before any use.
  virtual void adopt_reference(std::unique_ptr<ReferenceFactor> reference, const TissueState& state) {
    static_cast<void>(reference);
    static_cast<void>(state);
  }
};

// The model must outlive the compliance. std::invalid_argument: h ≤ 0.
std::unique_ptr<Compliance> make_compliance(ComplianceMethod method, const TissueModel& model, double h,
                                            const ComplianceOptions& options = {});

// A refactorisation each step: the model of accuracy. Of a linear body only where elements went or the zone
// moved.
std::unique_ptr<Compliance> make_exact_compliance(const TissueModel& model, double h,
                                                  const ComplianceOptions& options = {});

// A reference factor, its far field stale, with a fresh corner each step (zone_reference.h). `patch`
// gives nodes outside the reference factor's zone too, by one sparse half solve for each.
std::unique_ptr<Compliance> make_zone_compliance(const TissueModel& model, double h,
                                                 const ComplianceOptions& options = {});

}  // namespace hapticd
