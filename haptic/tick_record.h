// Everything that a tick's force came from, but the problems: enough to run the tick again.
//
// The clock that a bounded contact solve asks (HapticInput::deadline) is recorded as its answers, in the
// order of asking; a solve that gets the same answers does the same. Units: as device.h. Plain values.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "haptic/haptic_step.h"
#include "haptic/tuning.h"

namespace hapticd {

// Of one device.
struct DeviceFacts {
  DeviceInput input;
  bool retuned = false;  // `tuning` came before this tick
  DeviceTuning tuning;
  Vec3 force = Vec3::Zero();   // the answer, device frame [N]
  Vec3 torque = Vec3::Zero();  // [N·m]
  std::uint32_t status = 0;
};

struct TickFacts {
  std::int64_t now_ns = 0;  // HapticInput's, as the next
  std::int64_t period_ns = 0;
  std::uint64_t tick = 0;     // ForceSample::sequence
  std::uint64_t problem = 0;  // number of the publication in use; 0: none
  int devices = 1;
  EachInstrument<DeviceFacts> device;
};

struct ClockAnswers {
  static constexpr std::size_t capacity = 480;  // of one tick; a solve asks some hundred times at most

  std::size_t count = 0;  // also of those that did not fit
  std::array<std::int32_t, capacity> left_ns;

  std::size_t kept() const noexcept { return std::min(count, capacity); }
};

// Copies only the answers that there are.
struct TickRecord {
  TickFacts facts;
  ClockAnswers clock;

  TickRecord() noexcept {}
  TickRecord(const TickRecord& other) noexcept { *this = other; }
  TickRecord& operator=(const TickRecord& other) noexcept {
    facts = other.facts;
    clock.count = other.clock.count;
    std::copy_n(other.clock.left_ns.begin(), clock.kept(), clock.left_ns.begin());
    return *this;
  }
};

}  // namespace hapticd
