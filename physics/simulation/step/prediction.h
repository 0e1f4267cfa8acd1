// The last stage of a step: bodies are linearised where the instruments are about to take them.
//
//   the contact solve of the problem at hand, at the pose `lead` later → f → Δx_p → predicted_linearisation.h
//
// For the middle of the problem's use; after a removal, when the problem is refreshed (refresh.h), for its
// begin. Nothing of the solve is remembered but what it foresees. Units: m, N, s. Errors: a solve that is not
// usable presses nothing.
#pragma once

#include <memory>
#include <vector>

#include "physics/simulation/step/factor_stage.h"

namespace hapticd {

class Prediction {
 public:
  explicit Prediction(const WorldSettings& settings);

  bool active() const { return scratch_ != nullptr; }

  // Contact at X, from where the problem was made. on_the_way: a thin piece that a removal left may give way
  // to either side of the instrument, or be held by friction; it is met on the way.
  ContactSolution solve(const StepContext& c, const CondensedProblem& problem, const InstrumentPoses& X,
                        const ContactState& before, bool on_the_way);

  // By node of the patch: of the last solve [N].
  VecX force(const CondensedProblem& problem) const;

  // Where the bodies will be; problem: at the end of the step, before C_pp and positions are renewed. Returns
  // those that can be linearised there …
  std::vector<int> foresee(const StepContext& c, FactorStage& factors, const CondensedProblem& problem,
                           const InstrumentSamples& samples, const ContactState& before, bool removing);

  // … and linearises one of them.
  void linearise(const StepContext& c, FactorStage& factors, int b, const InstrumentSamples& samples,
                 StepReport& report) const;

 private:
  std::unique_ptr<ContactScratch> scratch_;  // only with a lead
};

}  // namespace hapticd
