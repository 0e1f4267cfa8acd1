// How long a solve may still take, asked of whoever owns a clock.
//
// Physics has no clock: the haptic loop (or a chart) hands in a function. Without one nothing is bounded by
// time, only by counts. `left_ns` may be called some hundred times in a solve.
// Thread safety: called from the solving thread only.
#pragma once

#include <cstdint>
#include <limits>

namespace hapticd {

struct Deadline {
  std::int64_t (*left_ns)(const void* clock) noexcept = nullptr;  // until the deadline; negative: passed
  const void* clock = nullptr;
  std::int64_t reserve_ns = 0;  // to be left for what comes after

  bool bounded() const noexcept { return left_ns != nullptr; }
  std::int64_t left() const noexcept {
    return left_ns ? left_ns(clock) - reserve_ns : std::numeric_limits<std::int64_t>::max();
  }
  bool passed() const noexcept { return left_ns && left() <= 0; }
};

}  // namespace hapticd
