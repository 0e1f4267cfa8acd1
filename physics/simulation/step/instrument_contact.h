// The instruments against what is near them and one another: the patch, its compliance, the contact solve,
// and the correction.
//
//   gather    surface near the pose → nodes, samples, x_now, x_free          (patch.h)
//   condense  C_pp of the patch's nodes
//   solve     λ at this pose, and with it the force on the patch's nodes     (contact_solve.h)
//   correct   Δx = Δx_free + C Hᵀλ, or so much of it as makes no energy      (energy_bound.h)
//
// `state` is what one solve hands to the next; the scratch is apart. Units: m, N, m/N. Shapes: see
// condensed_problem.h. Errors: by the solution's status; a solution that is not `usable` moves nothing.
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "physics/simulation/body_contact/collision.h"
#include "physics/simulation/step/factor_stage.h"

namespace hapticd {

struct InstrumentContactState {
  ContactState solver;
  VecX patch_force;  // of the instrument on the patch's nodes, its suction too [N]
};

ContactOptions contact_options(const WorldSettings& settings);

// Σ Hᵀλ of a solve, by node of the patch [N].
VecX force_on_patch(const CondensedProblem& problem, const ContactScratch& scratch);

// What suction pulls with, by node of the patch [N].
VecX pull_on_patch(const CondensedProblem& problem);

// The same of the forces remembered from another patch, found again by sample.
VecX remembered_force(const CondensedProblem& problem, const ContactMemory& memory);

// Moves all awake bodies; contacts between bodies push too. responses: C f of each body, where it is known;
// else empty. Returns how many were held back.
int correct_bodies(const StepContext& c, const VecX& patch_force, std::span<const VecX> responses = {});

class InstrumentContact {
 public:
  explicit InstrumentContact(double sample_spacing);

  // Fills all of a problem but C_pp. near: the faces near X.
  void gather(const StepContext& c, const InstrumentPoses& X, std::span<const NearFace> near,
              std::span<const PatchNode> first, bool topology_changed, CondensedProblem& problem);

  // A problem's number: they count up from 1, with every publication.
  std::uint64_t next_number() { return ++problems_; }

  // x_now and x_free of the present state and free motion.
  void place(const StepContext& c, CondensedProblem& problem) const;

  // Contact of the problem that a step ends with, at the poses it was gathered at, into the problem.
  // presses: whether the step's solve did.
  void publish_contact(const StepContext& c, const InstrumentSamples& samples, bool presses,
                       CondensedProblem& problem);

  void condense(const StepContext& c, FactorStage& factors, const InstrumentSamples& samples,
                CondensedProblem& problem, StepReport& report);

  // last: wrenches at these poses, of the problem published last; the step is then reported as a handover.
  void solve(const StepContext& c, const InstrumentSamples& samples, const CondensedProblem& problem,
             const std::optional<EachInstrument<Vec6>>& last, StepReport& report);

  // To before the last solve, to make it again with another pull: from the forces that it ended with, and
  // only until its rows hold good.
  void go_back(const StepContext& c, const InstrumentContactState& before);

  const PatchGatherer& patch() const { return gatherer_; }
  ContactScratch& scratch() { return *scratch_; }
  const ContactScratch& scratch() const { return *scratch_; }

  InstrumentContactState state;

 private:
  PatchGatherer gatherer_;
  std::unique_ptr<ContactScratch> scratch_;            // of the step's solve
  std::unique_ptr<ContactScratch> published_scratch_;  // … and of the problem's that it ends with
  bool on_the_way_ = false;                            // the last solve met tissue before its pose
  bool again_ = false;                                 // the next one is that again
  MatX block_;
  std::uint64_t problems_ = 0;
};

}  // namespace hapticd
