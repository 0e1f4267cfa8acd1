// A problem made again before the next step, after one that removed something.
//
// With rotations held a body is linear, and a problem depends on them alone. What a removal leaves may be
// thin: a corner on two elements is turned by half a radian, or buckles, in a third of a step. So where the
// last problem, solved on the way to where the instrument is going, says that elements have turned, they get
// the rotation of there (stale_rotation.h). Patch and samples stay. Not where a patch node is outside the
// zone. Units: m, N. Errors: by the answer.
#pragma once

#include <vector>

#include "physics/simulation/step/interim.h"
#include "physics/simulation/step_context.h"

namespace hapticd {

inline constexpr double middle_of_refresh = 0.15;  // of a step, after the pose that a refresh is asked for

class Refresh {
 public:
  // A step begins: its problem has not been refreshed.
  void forget() { changes_.clear(); }

  // patch_force: of the contact that is foreseen, by node of `problem`. False: nothing turned.
  bool apply(const StepContext& c, const VecX& patch_force, CondensedProblem& problem);

 private:
  bool apply_to_body(const StepContext& c, int b, const VecX& patch_force, CondensedProblem& problem);

  std::vector<Condensed> changes_;  // per body: from the last step's problem to its newest refresh
};

}  // namespace hapticd
