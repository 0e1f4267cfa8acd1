// The stage that gives each awake body a factor and a free motion, and those of the state just reached.
//
//   run    zone at the instrument, rotations, A(u), factor, Δx_free     where they are not those foreseen
//   renew  Δx_free at the corrected state, with the same factor; or foreseen from the correction alone, where
//          the compliance solves in halves and a predicted linearisation follows (free_motion.h)
//
// With reference factors made elsewhere, a free motion that is not plausible makes the step build its
// reference factor itself. Errors: std::runtime_error from the factor of a singular body.
#pragma once

#include <span>

#include "physics/simulation/step/reference_scheduling.h"
#include "physics/simulation/step_context.h"
#include "physics/simulation/step_report.h"

namespace hapticd {

// The most nodes of a body's patch that may lie outside its factor's zone: each costs a half solve.
inline constexpr int most_outside = 12;

class FactorStage {
 public:
  FactorStage(const WorldSettings& settings, std::size_t bodies);

  void run(const StepContext& c, const InstrumentSamples& samples, StepReport& report);
  void renew(const StepContext& c, bool looks_ahead, StepReport& report);

  // One body, asleep or not covered: zone at the instrument, factor, free motion.
  void factor(const StepContext& c, int body, StepReport& report);

  // The zone follows the instrument. nodes: that the patch has, or is to have.
  void follow(const StepContext& c, int body, const InstrumentSamples& samples, std::span<const int> nodes);

  // These nodes of the patch are to be had from the compliance now.
  void cover(const StepContext& c, int body, const InstrumentSamples& samples, std::span<const int> nodes,
             StepReport& report);

  // False: Δx_free takes nodes far, and one step of refinement would change it by its own size.
  bool plausible(const StepContext& c, Body& body) const;

  // A reference factor of the present state, in this step, however long that takes.
  void make_reference(const StepContext& c, int body, StepReport& report);

  // Its Δx_free after the correction is foreseen, not computed.
  bool foresees(const Body& body) const;

  ReferenceScheduling references;

 private:
  // Δx_free anew with a better factor, if need be.
  void make_plausible(const StepContext& c, int body, StepReport& report);
  // Nodes that Δx_free takes far join the zone. False: it is as it was.
  static bool extend_where_far(Body& body);
  bool move_zone(const StepContext& c, int body, const InstrumentPoses& X, std::span<const int> first,
                 std::span<const int> needed) const;

  bool keeps_references_;
  bool factors_in_step_;  // `exact`: few nodes outside its zone cost less than another factor
  bool predicts_;
};

}  // namespace hapticd
