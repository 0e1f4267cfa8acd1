// A haptic loop's contact solves, a millisecond each unless said otherwise.
#pragma once

#include <memory>

#include "physics/contact/contact_solve.h"

namespace hapticd {

// One loop's own state and scratch.
struct ContactLoop {
  double period = 1e-3;
  ContactOptions options;
  ContactState state;
  std::unique_ptr<ContactScratch> scratch = std::make_unique<ContactScratch>();

  ContactLoop() { options.margin = 0.15e-3; }

  ContactSolution solve(const CondensedProblem& problem, const Instrument& instrument, const Pose& X) {
    return solve_contact(problem, instrument, X, period, options, state, *scratch);
  }
};

}  // namespace hapticd
