// Solvers of the joint contact problem, on problems taken from the steps of stirred scenes (joint_problem.h).
//
//   ours        as the step: lcp.h without friction, coulomb.h to 1e-10 with it; no deadline
//   sap         sap_baseline.h with R of 5e-7 of a touch's compliance
//   sap_soft    … of 1/(4π²), Drake's near-rigid regime
//   pgs         projected Gauss-Seidel (pgs_baseline.h), to half of what a step asks
//
// Each stands where the step has its solver: it is given the touches that free motion closes, then those that
// its answer closes by a nanometre, until there are none (body_contact_solve.cpp). All start from λ = 0; a
// problem is solved three times where that is quick, and the least time counts. Baselines have `budget_us` and say what they have
// by then. The residual is the natural map of W, q and λ of all touches, without any compliance added.
// failures: residuals above 1e-6, what a step asks; unfinished: answers that the solver does not call solved.
// With friction a convex solver solves another law (sap_baseline.h): it finishes and fails.
// Sizes: a problem of more touches than `touches` gives one of as many, those that bore force in the step and
// then the nearest (nearest_touches); nothing is put together. Units: µs, m, N.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/scene/scene.h"
#include "tools/chart/pieces/joint_problem.h"
#include "tools/cli/report.h"

namespace hapticd {

struct PieceSolverSettings {
  std::vector<int> touches = {10, 30, 100, 200, 400};
  int steps = 600;    // of each scene
  int problems = 20;  // of each scene and size
  unsigned seed = 1;
  double budget_us = 200e3;
};

struct PieceSolverPoint {
  std::string name;
  std::string scene;
  int touches = 0;
  bool friction = false;
  int problems = 0;
  int active = 0;  // touches that bear force by ours, at most
  Quantiles us, residual;
  int failures = 0, unfinished = 0;
};

// From the steps of a scene, evenly; each whole.
std::vector<JointProblem> capture_joint_problems(const Scene& scene, const PieceSolverSettings& settings,
                                                 const std::function<bool(double)>& progress);

// A point for each solver, size and kind that there are problems of.
std::vector<PieceSolverPoint> compare_solvers(const std::string& scene,
                                              const std::vector<JointProblem>& problems,
                                              const PieceSolverSettings& settings,
                                              const std::function<bool(double)>& progress);

}  // namespace hapticd
