// What one action of the simulation's schedule met: enough to perform it again (schedule_replay.h).
#pragma once

#include "server/schedule/step_schedule.h"

namespace hapticd {

// A plain value. `adopted` records come before the `begin` in which their reference factors are adopted.
struct StepRecord {
  StepAction action = StepAction::begin;
  bool adopted = false;
  bool failed = false;                // adopted: it could not be made
  JobKind kind = JobKind::reference;  // adopted: what
  std::int32_t body = 0;              // … and whose
  std::int64_t asked_ns = 0;          // PlannedAction's, as the next
  std::int64_t step_ns = 0;
  InstrumentSamples samples = {};  // begin, finish, refresh: that were latched
  std::uint64_t problem = 0;       // publish…: its number
  std::int64_t published_ns = 0;   // …
};

}  // namespace hapticd
