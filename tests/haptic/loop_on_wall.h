// What tests of the loop share: devices with wide limits on the wall of wall.h, and states that press into it.
#pragma once

#include "haptic/clock.h"
#include "haptic/loop.h"
#include "tests/haptic/wall.h"

namespace hapticd {

inline constexpr std::int64_t ms = 1'000'000;  // [ns]

struct LoopOnWall {
  DeviceSettings device;
  HapticOptions options;
  Channel<CondensedProblem> problems;  // of two instruments like wall.h's
  Channel<InstrumentInputs> inputs;

  LoopOnWall() {
    device.max_force = 3;
    device.max_force_rate = 1e4;
    device.max_speed = 1;
    options.watchdog.problem_old_ns = 10'000 * ms;  // one problem serves the whole test
    options.watchdog.problem_lost_ns = 20'000 * ms;
    wall::make(problems.back(), 1, monotonic_ns());
    problems.back().instrument[1] = problems.back().instrument[0];
    problems.publish();
  }

  // A tenth of a millimetre deep.
  static DeviceSample pressing(std::uint64_t sequence, std::int64_t now_ns) noexcept {
    DeviceSample sample;
    sample.sequence = sequence;
    sample.received_ns = now_ns;
    sample.enable = true;
    sample.pose.p.z() = wall::radius - 0.1e-3;
    return sample;
  }
};

}  // namespace hapticd
