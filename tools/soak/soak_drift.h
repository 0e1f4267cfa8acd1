// Whether a soak's last third is as its first: percentiles minute by minute, and memory.
//
//   drift = median of a percentile over the last third's minutes / over the first third's, either way round
//   judged: drift / max(1, drift of the public tool's same percentile), so that what the machine itself did
//   meanwhile is granted
//   growth = median of the memory over the last third's minutes − over the first third's
//
// Bounds: p50 1.25, p99 1.5, p99.9 2 (twenty ticks a minute; only where the public tool has one), growth 2
// MB. Judged from three minutes on. A wake-up late by less than 1 µs counts as 1 µs: that is reading the
// clock. The loop is early (haptic/loop.h), so its p99.9 is a difference of two near numbers and strays most.
#pragma once

#include "tools/soak/soak_verdict.h"

namespace hapticd {

// Ratio of the two medians, at least 1; 1 where one is empty.
double drift(const std::vector<double>& first, const std::vector<double>& last);

// A value of each minute, of the first and of the last third of them.
struct Thirds {
  std::vector<double> first, last;
};
template <typename F>
Thirds thirds(const std::vector<SoakFigures>& minutes, F&& value) {
  Thirds t;
  const std::size_t third = minutes.size() / 3;
  for (std::size_t i = 0; i < third; ++i) {
    t.first.push_back(value(minutes[i]));
    t.last.push_back(value(minutes[minutes.size() - third + i]));
  }
  return t;
}

// {"wake_p50", …, "memory_growth_mb"}, ratios as found; null below three minutes. Appends to `checks`.
nlohmann::ordered_json check_drift(const SoakRecord& record, std::vector<SoakCheck>& checks);

}  // namespace hapticd
