// One contact solve as the haptic loop met it: all that is needed to solve it again elsewhere.
//
//   solve_contact(problem, instruments, X, period, options(…), state, …) → status, residual, wrench
//
// Filled by the loop's thread in a channel's slot, in place; only what is in use is copied (at most 0.8 MB).
// Units: m, N, s.
#pragma once

#include "physics/contact/contact_solve.h"

namespace hapticd {

struct ContactCapture {
  CondensedProblem problem;
  ContactState state;  // before the solve
  InstrumentPoses X;   // devices, scene
  double period = 0;   // [s]
  double margin = 0;   // [m]
  int linearisations = 0;
  double tolerance = 0;                      // of the Coulomb solver
  SolveStatus status = SolveStatus::solved;  // what came out
  double residual = 0;
  EachInstrument<Vec6> wrench;
};

}  // namespace hapticd
