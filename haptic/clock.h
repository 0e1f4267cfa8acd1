// The clock that all intended times count by: CLOCK_MONOTONIC [ns]. Thread safety: any thread. Guarantee:
// noexcept, no allocation.
#pragma once

#include <cstdint>

namespace hapticd {

std::int64_t monotonic_ns() noexcept;

// Goes on sleeping after a signal.
void sleep_until(std::int64_t ns) noexcept;

}  // namespace hapticd
