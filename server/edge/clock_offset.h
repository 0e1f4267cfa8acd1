// Another machine's clock, learnt from round trips.
//
//   offset = ((t₁ − t₀) + (t₂ − t₃)) / 2,   |error| ≤ ((t₃ − t₀) − (t₂ − t₁)) / 2 + drift · (now − t₃)
//
// t₀ asked and t₃ answered here, t₁ heard and t₂ answered there; offset: their clock less ours. The round
// trip whose error is bounded best now is kept. Half a round trip is what a route that is slow one way alone
// may hide. Units: ns. Guarantee: noexcept, no allocation. Source: RFC 5905, 8.
#pragma once

#include <cstdint>

namespace hapticd {

struct RoundTrip {
  std::int64_t asked_ns = 0, heard_ns = 0, answered_ns = 0, back_ns = 0;  // t₀ … t₃
};

class ClockOffset {
 public:
  // What two clocks may run apart: the kernel turns a clock by at most so much.
  static constexpr double drift = 500e-6;

  // A trip that ends before it begins, here or there, or takes longer there than altogether is left out:
  // false.
  bool note(const RoundTrip& trip) noexcept;
  void forget() noexcept { known_ = false; }

  bool known() const noexcept { return known_; }
  std::int64_t ns() const noexcept { return offset_ns_; }
  std::int64_t error_ns(std::int64_t now_ns) const noexcept;
  std::int64_t round_trip_ns() const noexcept { return 2 * half_trip_ns_; }  // of the one that is kept
  std::int64_t ours(std::int64_t theirs_ns) const noexcept { return theirs_ns - offset_ns_; }
  std::int64_t theirs(std::int64_t ours_ns) const noexcept { return ours_ns + offset_ns_; }

 private:
  bool known_ = false;
  std::int64_t offset_ns_ = 0, half_trip_ns_ = 0, learnt_ns_ = 0;
};

}  // namespace hapticd
