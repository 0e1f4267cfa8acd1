// A compliance that keeps a reference factor: the factor (or inverse) of an earlier A, corrected for what
// went and turned since. A newer one can be made elsewhere, on any one thread, and adopted between two steps.
//
//   const auto compliance = make_reference_compliance(ComplianceMethod::zone, model, h, options);
//   compliance->update(state);                                     // the first update makes one itself
//   if (compliance->report().wants_reference) {
//     auto reference = compliance->snapshot_reference(state);
//     reference->make();                                           // the expensive part, anywhere
//     compliance->adopt_reference(std::move(reference), state);    // the state may have moved on
//     compliance->update(state);
//   }
//
// Two halves of a solve, for a force f near the zone that is known only after the free motion C b:
//
//   if (compliance->start_solve(b, y) == Solved::forward) compliance->finish_solve(f, y);    // y = C (b + f)
//
// Units, shapes and errors as in compliance.h. Methods: zone, lazy, updown.
#pragma once

#include "physics/compliance/compliance.h"

namespace hapticd {

// A reference factor under way.
class ReferenceFactor {
 public:
  virtual ~ReferenceFactor() = default;

  // The expensive part, on any one thread: touches nothing of the compliance that gave it out, nor of the
  // model or the state. Throws std::runtime_error only.
  virtual void make() = 0;
};

// How far a solve y = C b has come. forward: y is known near the zone alone, and `finish_solve` gives the
// rest. whole: y is known everywhere, and there is nothing to finish.
enum class Solved : std::uint8_t { forward, whole };

class ReferenceCompliance : public Compliance {
 public:
  // What a new reference factor of this state and the wanted zone needs. Removals told to the compliance
  // after this call are carried over when it is adopted.
  [[nodiscard]] virtual std::unique_ptr<ReferenceFactor> snapshot_reference(const TissueState& state) = 0;

  // Pre: `reference` is of this compliance's own `snapshot_reference`, and made; std::invalid_argument
  // otherwise. An `update` must follow before any use.
  virtual void adopt_reference(std::unique_ptr<ReferenceFactor> reference, const TissueState& state) = 0;

  // Nodes next to the zone wanted of the next reference factor: they are outside it, but their patches are to
  // be cheap too.
  virtual void move_halo(std::span<const int> nodes) { static_cast<void>(nodes); }

  // These nodes are asked for again and again: where it costs less, they join the zone of the reference
  // factor at the next `update`.
  virtual void extend_zone(std::span<const int> nodes) { static_cast<void>(nodes); }

  // Post: y = C b where `forward_covers`, and zero elsewhere if the answer is `forward`. An update, a removal
  // or a new reference factor ends what was started.
  [[nodiscard]] virtual Solved start_solve(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y);

  // Pre: the last `start_solve` answered `forward` and nothing ended it; std::runtime_error otherwise. f is
  // zero where `forward_covers` does not hold. Post: y = C (b + f).
  virtual void finish_solve(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y);

  // True if `start_solve` gives every free node of `nodes`: those of the zone, and of the halo.
  [[nodiscard]] virtual bool forward_covers(std::span<const int> nodes) const { return zone_covers(nodes); }

  // Pre: f is zero outside the zone. Post: y = C f on the zone's nodes; elsewhere it is not promised. Ends no
  // solve that was started.
  virtual void apply_in_zone(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) { apply(f, y); }

  // ‖C A y − y‖∞/‖y‖∞ with the A of this state: what a step of refinement would change of y. From 1 on, an
  // error like y grows from step to step, as 1 − C A does to it. Measured by `zone` alone; 0 of the others.
  [[nodiscard]] virtual double disagreement(const TissueState& state, const VecX& y);
};

// method: zone, lazy or updown; std::invalid_argument for the others, or h ≤ 0. The model must outlive it.
[[nodiscard]] std::unique_ptr<ReferenceCompliance> make_reference_compliance(
    ComplianceMethod method, const TissueModel& model, double h, const ComplianceOptions& options = {});

// The reference factor's far field is stale, and its corner fresh each step (zone_reference.h). `patch` gives
// nodes outside the reference factor's zone too, by one sparse half solve for each.
[[nodiscard]] std::unique_ptr<ReferenceCompliance> make_zone_compliance(
    const TissueModel& model, double h, const ComplianceOptions& options = {});

// The same object; null if its method keeps no reference factor.
[[nodiscard]] ReferenceCompliance* as_reference_compliance(Compliance* compliance) noexcept;

}  // namespace hapticd
