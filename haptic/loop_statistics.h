// What the haptic loop counts about itself, readable by any thread while it runs.
//
//   scheduled = run + missed;   answered ≤ run
//
// A slot is one intended wake-up; in mode `event`, one arrival or the fallback's wake-up. run: ticks
// executed, each sends one force. missed: slots that passed during a late or long tick and are not made up
// for. deadline_misses: ticks that ended after the next intended wake-up; one such tick may miss many slots.
// answered: ticks with a new valid device state. late_states: ticks that had to wait for theirs (loop.h). A
// missed slot enters `wake` and `timer` with the time until the tick that blocked it was over, so a stall
// cannot hide (no coordinated omission).
// Thread safety: the loop's thread alone writes; all reads are relaxed and may lag.
#pragma once

#include "haptic/histogram.h"

namespace hapticd {

struct LoopStatistics {
  Histogram wake;         // lateness against the intended time
  Histogram timer;        // of the thread's sleep, mode `tick`: what of it is more than the loop is early
  Histogram solve;        // the whole haptic step, ticks with a contact solve
  Histogram write;        // handing the force to the device port
  Histogram interval;     // from one tick's beginning to the next's
  Histogram state_age;    // tick − receipt of the state, ticks that answer one
  Histogram problem_age;  // tick − publication, ticks with a problem

  std::atomic<std::uint64_t> run{0};
  std::atomic<std::uint64_t> missed{0};
  std::atomic<std::uint64_t> deadline_misses{0};
  std::atomic<std::uint64_t> answered{0};
  std::atomic<std::uint64_t> late_states{0};
  std::atomic<std::uint64_t> refused{0};  // device states
  std::atomic<std::uint64_t> conflicts{0};
  std::atomic<std::uint64_t> solver_caps{0};                  // contact solves that ended at their cap
  std::atomic<std::uint64_t> contacts_dropped{0};             // ticks in which contacts or tissue did not fit
  std::atomic<bool> silent{false};                            // disarmed because no state of its client came
  std::atomic<std::uint32_t> samples{0}, samples_dropped{0};  // of the newest force's problem
  std::atomic<std::uint32_t> status{0};                       // of the newest force
  std::atomic<std::uint64_t> page_faults{0};                  // of the loop's thread since it was first armed
  std::atomic<double> force_peak{0};                          // [N]
  std::atomic<double> penetration_max{0};                     // scene, while force is rendered [m]
  std::atomic<std::int64_t> first_ns{0};                      // intended time of the first slot; 0: not begun
  std::atomic<std::int64_t> next_ns{0};                       // intended time of the next slot

  std::uint64_t scheduled() const noexcept {
    return run.load(std::memory_order_relaxed) + missed.load(std::memory_order_relaxed);
  }
};

}  // namespace hapticd
