// The published patch as a haptic tick needs it: viscous forces follow the tick's own time.
//
//   published, step h     A = s_h K,  s_h = 1 + β/h,   x_free = (x_eq + (β/h) x_now) / s_h
//   here, tick T          A = s_T K,  s_T = 1 + β/T',  T' = T + a
//                         x_free ← (x_eq + (β/T') x_before) / s_T,  C_pp ← C_pp s_h/s_T (column_scale)
//   after the solve       x_before ← x_before + (T/T') (x − x_before)
//
// β is the stiffness-proportional damping of the node's body (B = βK). x_before is where the patch was after
// the previous tick. With a lag a it is where the dashpot is, in series with a spring (Maxwell, implicit
// Euler). A published problem knows only its own step's velocity, so without this the force of tissue that
// is pushed at constant speed would grow over the step. Mass and αM are left out: at the tick's scale the
// patch is quasi-static beside its viscosity. At rest both problems are equal. x_before and grips are carried
// from problem to problem by sample ids; new nodes begin where they are, and free. T that changes by less
// than a twentieth counts as the same: the viscous force errs by that share. T > 0. Units: SI. Guarantee:
// noexcept, no allocation, wait-free; one copy of the problem, but for C_pp, when it is new.
#pragma once

#include <array>

#include "physics/contact/suction.h"

namespace hapticd {

struct ViscousOptions {
  double step = 0;                      // h of the simulation [s]; 0: the problem is used as published
  std::array<double, 16> relaxation{};  // β per body, 0 where it has none [s]
  double lag = 0;                       // a [s]
  bool always = false;  // a problem of its own also where nothing is viscous: x_free is changed
};

// The lag of a device whose encoders know positions to `quantum` [m] and that displays the coupling as
// `stiffness` [N/m]: one quantum read makes β K Δ/T newtons for a tick, so β K Δ²/T of energy that is
// nobody's work. 0 where that is too little to be felt, and where a quantum makes more force than such
// devices have: energy is then made with a lag as without, and the lag only costs steadiness.
double lag_for(double quantum, double stiffness, double relaxation, double period) noexcept;

struct ViscousPatch {
  CondensedProblem problem;  // what the tick solves, with C_pp of the published one
  std::uint64_t step = 0;    // of the problem it was made from; 0: none, nothing is remembered
  double published = 0;      // h that C_pp is of [s]
  double period = 0;         // T' [s]
  double lag = 0;            // a [s]
  double share = 1;          // T/T'
  PatchPositions before;
  PatchPositions equilibrium;  // x_eq
  EachInstrument<Grip> grip;   // of the ports, after the solve before
  std::array<double, max_patch_nodes> relaxation;
};

// The problem to be solved in this tick, patch.problem; `published` itself where rows are frozen, or nothing
// is viscous and it need not be another. It is to stay as it is until the next one has been met.
const CondensedProblem& at_tick(const CondensedProblem& published, const ViscousOptions& options,
                                double period, ViscousPatch& patch) noexcept;

// The problem of the solve before, for another T: of the part of a tick in which it was the newest. None
// where nothing is remembered, or what it was made from is not there any more.
const CondensedProblem* at_part_of_tick(double period, ViscousPatch& patch) noexcept;

// After the solve of either: where it left the patch.
void remember(const PatchPositions& x, ViscousPatch& patch) noexcept;

}  // namespace hapticd
