// A body's compliance C = A⁻¹, A = M/h² + B/h + K(u), behind one small interface.
//
//   free motion  Δx_free = C (M v/h + f_ext + f_int(x)),   correction  Δx = Δx_free + C Hᵀλ,
//   patch        C_pp = Eₚᵀ C Eₚ
//
// The nodes near the instrument (the zone) are ordered last, so that C_pp comes from the factor's
// trailing dense corner: L_zz L_zzᵀ = A_zz − A_zr A_rr⁻¹ A_rz.
// Methods that keep a base (a factor or an inverse of an earlier A) say after each update how far they are
// from the present A, and when they want a new base; the base can be made elsewhere, on any one thread, and
// adopted between two steps. Nothing here starts a thread.
// Units: A [N/m], C [m/N]; multipliers are newtons for every h. Shapes: vectors of 3·nodes, node-wise
// interleaved; fixed and orphan nodes are identity rows: their entries of every result are zero.
// Errors: `update` throws std::runtime_error when A is not positive definite (a singular model: no
// mass and no support); `apply`, `patch` and `report` throw it before a successful update.
// Source: the paper, eqs. (2) and (3). Departure: only `lazy` treats a removal as the paper does.
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

// How the base is turned with the tissue: not; each node by its own turn, as the paper; all nodes of a
// connected piece by the piece's mean turn (node_turn.h: what each is good for).
enum class Warping : std::uint8_t { none, node, piece };

// Who factors A for `exact`: our own fronts (multifrontal_factor.h), or CHOLMOD, the oracle and fallback.
enum class Factorisation : std::uint8_t { multifrontal, cholmod };

struct ComplianceOptions {
  double good_error = 1e-6;        // sampled error above it: not `good`
  double rebase_error = 0.03;      // … above it: a base is wanted
  double usable_error = 0.1;       // … above it: degraded
  double rebase_rotation = 0.5;    // largest `rotation_since_base` that is left alone
  int rebase_age = 1000;           // updates since the base that are left alone
  int rebase_removed = 64;         // removals carried over as low-rank terms that are left alone
  int most_carried = 256;          // zone: more of them are not carried, but wait for the next base
  bool base_on_the_spot = true;    // zone: which `update` then makes itself, late; false: somebody else does
  int sample_every = 1;            // updates between two samples of the error
  std::optional<Warping> warping;  // default: zone by piece; lazy, updown and dense by node, as the paper
  bool rounded_base = false;       // zone: solve with a rounded copy of the base factor (rest_panels.h)
  NodeOrder updown_order = NodeOrder::zone_last;
  Factorisation factorisation = Factorisation::multifrontal;
  int lazy_rebase_after = 0;   // lazy: removals after which `update` makes a new base; 0: never, as the paper
  PartTimes* times = nullptr;  // of the step it is part of: `update` tells assembly from factor
};

// good: the sampled error is below `good_error`, and nothing has moved since the sample. rebase_wanted:
// usable, and not proven better. degraded: the error is above `usable_error`, or the base failed.
enum class ComplianceHealth : std::uint8_t { good, rebase_wanted, degraded };

// Of the last update; residual and error of the last sample, 0 while a new base has none (never `good` then).
struct ComplianceReport {
  ComplianceHealth health = ComplianceHealth::good;
  bool wants_base = false;  // degraded, or a new base is due by error, rotation, age or what is carried
  double residual = 0;      // ‖A y − b‖/‖b‖ of one sampled solve y = C b, against the true A(u)
  double error = 0;         // ‖C (A y − b)‖/‖y‖, what one step of refinement would still change
  int removed_since_base = 0;
  int base_age = 0;  // updates since the base was made
  double rotation_since_base =
      0;  // largest of a node in the zone, beyond its piece's own where that is undone [rad]
  std::size_t memory_bytes = 0;  // of factor, inverse and terms
};

// A base under way: `make` is the expensive part. It may run on any one thread and touches nothing of the
// compliance that gave it out, nor of the model or the state. Throws std::runtime_error only.
class ComplianceBase {
 public:
  virtual ~ComplianceBase() = default;
  virtual void make() = 0;
};

class Compliance {
 public:
  virtual ~Compliance() = default;

  // The zone wanted: of the next `update` (exact, updown), or of the next base. Fixed nodes are allowed and
  // ignored. Patches of the nodes named first are the cheapest: name the nearest first.
  virtual void move_zone(std::span<const int> nodes) = 0;

  // Nodes next to the zone wanted of the next base: out of it, but their patches are not to be dear.
  virtual void move_ring(std::span<const int> nodes) { static_cast<void>(nodes); }

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
  // finish. An update, a removal or a new base in between ends it, and `finish` throws.
  virtual bool begin(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) {
    apply(b, y);
    return true;
  }
  virtual void finish(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y);

  // True if the halves know of every free node of `nodes`: those of the zone, and of the ring.
  virtual bool halves_cover(std::span<const int> nodes) const { return zone_covers(nodes); }

  // y = C f on the zone's nodes, of a force on the zone alone; what y has elsewhere is not promised. Nothing
  // that was begun is ended.
  virtual void apply_in_zone(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) { apply(f, y); }

  // C_pp of the given zone nodes, 3·|nodes| square, into `block` (rows of fixed or orphan nodes are zero).
  // Contract: zone_covers(nodes) at the last update; std::invalid_argument otherwise.
  virtual void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) = 0;

  // ‖C A y − y‖∞/‖y‖∞ with the A of this state: what a step of refinement would change of y. From 1 on, an
  // error like y grows from step to step, as 1 − C A does to it. 0: of a method that keeps no base.
  virtual double disagreement(const TissueState& state, const VecX& y) {
    static_cast<void>(state);
    static_cast<void>(y);
    return 0;
  }

  virtual ComplianceReport report() = 0;

  // What a new base of the present state and the wanted zone needs, to be made elsewhere; null for methods
  // that keep none. Removals told to the compliance after this call are carried over when it is adopted.
  virtual std::unique_ptr<ComplianceBase> snapshot_base(const TissueState& state) {
    static_cast<void>(state);
    return nullptr;
  }

  // Takes a made base of this compliance's own `snapshot_base`; an `update` must follow before any use.
  virtual void adopt_base(std::unique_ptr<ComplianceBase> base, const TissueState& state) {
    static_cast<void>(base);
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

// A base factor, its far field stale, with a fresh corner each step (zone_base.h). `patch`
// gives nodes outside the base's zone too, by one sparse half solve for each.
std::unique_ptr<Compliance> make_zone_compliance(const TissueModel& model, double h,
                                                 const ComplianceOptions& options = {});

}  // namespace hapticd
