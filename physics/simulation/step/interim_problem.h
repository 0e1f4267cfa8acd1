// The problem that is published as soon as a step has decided what goes, and the one published last.
//
// Gathered anew, at the step's own pose and on the new surface; C_pp and free motion are those of the factor
// that the last published problem was made with, less what went (interim.h). Surface that comes to light
// begins where the last problem's contact, solved at the present pose, holds it. Units: m, N. Errors: by the
// answer.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "physics/contact/contact_solve.h"
#include "physics/simulation/step_context.h"

namespace hapticd {

// The problem that the last step published, and a scratch to solve it with.
struct PublishedProblem {
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  std::unique_ptr<ContactScratch> scratch = std::make_unique<ContactScratch>();

  bool any() const { return problem->step > 0; }
  // At X, with what contact remembers; that is left as it was.
  ContactSolution solve(const StepContext& c, const InstrumentPoses& X, const ContactState& before) const;
};

// A force on the nodes of a patch that is no more.
struct PatchForce {
  std::vector<PatchNode> nodes;
  VecX force;  // [N]
};

// False: of these bodies, settings or pose no interim problem is made. gone: per body, as told to nobody yet.
bool has_interim_problem(const StepContext& c, const std::vector<std::vector<int>>& gone,
                         const InstrumentSamples& samples);

// Positions and C_pp of the patch just gathered, into `problem`. pressed: what held the bodies before. False:
// what is left has nothing that holds it, or a zone leaves too much out.
bool fill_interim_problem(const StepContext& c, const std::vector<std::vector<int>>& gone,
                          const PatchForce& pressed, CondensedProblem& problem);

}  // namespace hapticd
