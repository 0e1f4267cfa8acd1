// A recorded schedule run again: the same objects as the live loops (StepSchedule, HapticTick), driven by
// what was recorded in place of clocks, device and channels.
//
// Each tick has its own device state, clock answers and publication, each action of the simulation its own
// instrument, each reference factor its own step. What comes out is then the live run's, to the last bit on
// the same machine and program; on a processor with other kernels it differs by rounding. Not reproduced:
// what a test hook did to the live run. Errors: std::runtime_error where the run goes another way than the
// record says, and what World throws.
#pragma once

#include <functional>

#include "server/schedule/schedule_file.h"

namespace hapticd {

struct ReproducedTick {
  const TickFacts& live;
  EachInstrument<ForceSample> force;
  double off = 0;  // |f − f_live|, the largest of the devices [N]
};

struct Reproduction {
  std::size_t ticks = 0;
  double largest_off = 0, largest_torque_off = 0;  // [N, N·m]
  std::uint64_t worst_tick = 0;
  std::size_t other_status = 0;  // ticks with another status than live
  std::size_t unsure = 0;  // ticks that asked the clock more often than was recorded, or otherwise than live
  std::size_t without_problem =
      0;                 // ticks whose publication is not in the record, left out with all after them
  std::size_t gaps = 0;  // ticks that are missing in between
  int removed = 0;       // tetrahedra
  std::uint64_t publications = 0, references = 0;
};

// scene: as_run. `each` may end the run by returning false.
Reproduction replay_schedule(const Scene& scene, const Schedule& schedule,
                             const std::function<bool(const ReproducedTick&)>& each = {});

}  // namespace hapticd
