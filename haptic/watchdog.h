// The safety table as a pure state machine: what may the device feel in this tick?
//
//   no valid state for 3 / 10 / 100 ms           last force held / ramp to zero in 5 ms / release, disarmed
//   problem older than 60 / 200 ms               damping only, F = −b v, no more than was felt / release
//   own gap ≥ 5 ms                               that tick counts its state as being as old as the gap
//   state refused (sample_check.h)               as if it had not come; three in a row: release, latched
//   second client                                nothing, status_conflict for 100 ms
//   second daemon for the device                 ramp to zero, then disarmed and latched
//   client gone, enable false, not finite        zero in the same tick; not finite also latches
//
// Release goes to zero as fast as the slew limit allows. Only the last row steps to zero: nobody is there to
// feel the step, the client asks for it, or no finite number is left.
// Arming: the first valid state of a new client with enable true arms, and so does enable going false →
// true, once the problem is younger than 60 ms and nothing is latched. After disarming by age only false →
// true arms. Enable false clears a latch; a latch by a second daemon only when that daemon is no longer
// heard. A latch by refusals also ends with its client. Neither of two daemons arms.
// Gain: force = gain · (what `render` says). It falls in 5 ms while the state is older than 10 ms and rises
// in 100 ms otherwise, per period of the loop: the slots of a gap count as one.
// Units: ns, m/s. Time is an argument: there is no clock here. Guarantee: wait-free, no allocation.
#pragma once

#include "haptic/sample_check.h"

namespace hapticd {

struct WatchdogLimits {
  std::int64_t period_ns = 1'000'000;
  std::int64_t hold_after_ns = 3'000'000;
  std::int64_t ramp_after_ns = 10'000'000;
  std::int64_t disarm_after_ns = 100'000'000;
  std::int64_t problem_old_ns = 60'000'000;
  std::int64_t problem_lost_ns = 200'000'000;
  std::int64_t own_gap_ns = 5'000'000;
  std::int64_t ramp_down_ns = 5'000'000;
  std::int64_t ramp_up_ns = 100'000'000;
  std::int64_t conflict_shown_ns = 100'000'000;
  int refusals_to_latch = 3;
  double quaternion_tolerance = 1e-3;
};

// Problems that come late are felt until they are so old, and are lost 140 ms later [s].
inline void let_problems_grow_old(WatchdogLimits& limits, double old) noexcept {
  const std::int64_t more = limits.problem_lost_ns - limits.problem_old_ns;
  limits.problem_old_ns = static_cast<std::int64_t>(1e9 * old);
  limits.problem_lost_ns = limits.problem_old_ns + more;
}

// What the device is to feel, before the gain.
enum class Render : std::uint8_t { zero, release, hold, damp, contact };

struct WatchdogInput {
  std::int64_t now_ns = 0;
  Presence presence;
  bool taken = false;  // `sample` came since the last tick
  DeviceSample sample;
  bool has_problem = false;
  std::int64_t problem_published_ns = 0;
};

struct WatchdogState {
  bool has_sample = false;
  DeviceSample sample;            // newest valid one
  Vec3 velocity = Vec3::Zero();   // of the device, low-passed, at most max_speed [m/s]
  std::int64_t last_tick_ns = 0;  // 0: none yet
  bool may_arm = false;           // an edge or a new client was seen and not used yet
  bool armed = false;
  bool latched_by_refusals = false;
  bool latched_by_force = false;
  bool rival = false;  // heard in the newest tick
  bool latched_by_rival = false;
  std::int64_t rival_since_ns = 0;  // when that latch fell
  int refusals_in_a_row = 0;
  std::uint64_t refused = 0;  // since the beginning
  std::uint64_t conflicts = 0;
  std::int64_t conflict_until_ns = 0;
  double gain = 0;
};

struct Verdict {
  Render render = Render::zero;
  double gain = 0;  // 0 … 1
  std::uint32_t status = status_disarmed;
  Refusal refusal = Refusal::none;
  bool answers = false;              // a valid state came with this tick
  std::int64_t state_age_ns = -1;    // −1: there is no state
  std::int64_t problem_age_ns = -1;  // −1: there is no problem
};

Verdict watch(const WatchdogLimits& limits, const DeviceSettings& device, const WatchdogInput& input,
              WatchdogState& state) noexcept;

// Call it when a force is not finite: the device is disarmed and latched from now on.
void latch_not_finite(WatchdogState& state) noexcept;

}  // namespace hapticd
