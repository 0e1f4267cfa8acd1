// One contact solve as the haptic loop met it: all that is needed to solve it again elsewhere.
//
//   solve_contact(problem, instruments, X, period, options(…), state, …) → status, residual, wrench
//
// Filled by the loop's thread in a channel's slot, in place; only what is in use is copied (at most 0.8 MB).
// Units: m, N, s.
#pragma once

#include <cstdint>

#include "haptic/channel.h"
#include "haptic/haptic_step.h"
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

// Which solves are captured: those that ended at a cap, and every `every`-th one (0: none else), at most one
// in 20 ticks, each for about 0.1 ms. One thread; wait-free, no allocation.
class ContactCaptures {
 public:
  // The channel must outlive it.
  void into(Channel<ContactCapture>& captures, std::uint64_t every) noexcept {
    captures_ = &captures;
    every_ = every;
  }
  // What the next solve begins with.
  void before(const ContactState& state) noexcept {
    if (captures_) before_ = state;
  }
  // problem: what was solved, with the outcome in `state`.
  void after(const CondensedProblem& problem, const HapticState& state,
             const HapticOptions& options) noexcept;
  bool asked_for() const noexcept { return captures_ != nullptr; }

 private:
  Channel<ContactCapture>* captures_ = nullptr;
  std::uint64_t every_ = 0, solves_ = 0;
  std::uint64_t last_ = 0;  // its tick
  ContactState before_;
};

}  // namespace hapticd
