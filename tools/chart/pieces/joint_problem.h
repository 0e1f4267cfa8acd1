// The joint contact problem of a simulation step, taken from outside: instruments, bodies and pieces in one.
//
//   δ = W λ + q,  W = H C Hᵀ + J K⁻¹ Jᵀ;  rows n, t1, t2 a touch (one where no touch has friction)
//
// All touches within reach at the step's last linearisation, instruments' first; C is the bodies' compliance
// between the nodes they take hold of (exact: the step's own factor). Units: m, N. Errors: nothing where the
// step had no touch of bodies, or an element went in it.
#pragma once

#include <optional>
#include <vector>

#include "physics/simulation/world.h"

namespace hapticd {

struct JointProblem {
  MatX W;
  VecX q;
  std::vector<double> mu;  // empty: without friction, one row a touch
  VecX lambda;             // that the step applied

  int width() const { return mu.empty() ? 1 : 3; }
  int touches() const { return static_cast<int>(q.size()) / width(); }
};

// After a step that wrote `published`.
std::optional<JointProblem> joint_problem(const World& world, const CondensedProblem& published,
                                          const StepReport& report);

// Of these touches alone.
JointProblem part_of(const JointProblem& problem, const std::vector<int>& touches);

// Of so many touches: those that bore force, then those that free motion closes the most.
JointProblem nearest_touches(const JointProblem& problem, int touches);

// Natural map of λ: of lcp.h, or of coulomb.h.
double residual_of(const JointProblem& problem, const VecX& lambda);

}  // namespace hapticd
