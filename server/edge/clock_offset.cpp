#include "server/edge/clock_offset.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

// Later than this no machine has run: beyond it sums would not fit.
constexpr std::int64_t latest_ns = std::int64_t{1} << 61;

bool plausible(std::int64_t ns) noexcept { return ns >= 0 && ns < latest_ns; }

}  // namespace

bool ClockOffset::note(const RoundTrip& trip) noexcept {
  const auto& [t0, t1, t2, t3] = trip;
  if (!plausible(t0) || !plausible(t1) || !plausible(t2) || !plausible(t3)) return false;
  const std::int64_t there = t2 - t1, altogether = t3 - t0;
  if (there < 0 || altogether < there) return false;
  const std::int64_t half = (altogether - there + 1) / 2;
  if (known_ && half > error_ns(t3)) return true;
  known_ = true;
  offset_ns_ = (t1 - t0) / 2 + (t2 - t3) / 2;
  half_trip_ns_ = half;
  learnt_ns_ = t3;
  return true;
}

std::int64_t ClockOffset::error_ns(std::int64_t now_ns) const noexcept {
  const auto since = static_cast<double>(std::max<std::int64_t>(now_ns - learnt_ns_, 0));
  return half_trip_ns_ + std::llround(drift * since);
}

}  // namespace hapticd
