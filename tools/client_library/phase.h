// How a client finds its phase against the daemon's tick: how long before it states should leave.
//
// The ages that the daemon reports (tick − arrival, [µs]) are points on a circle of one period: an age of
// 0.02 ms and one of 0.98 ms are neighbours, and that neighbourhood is just where a state is taken twice or
// not at all. So their circular mean is used. Guarantee: noexcept, no allocation.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace hapticd {

// How far a client should move its slots, for states that are `wanted_us` old when they are taken. A positive
// shift sends later, hence fresher. Result in (−period/2, period/2]; 0 when there are no ages.
template <typename Ages>
double phase_shift_us(const Ages& ages_us, double period_us = 1000, double wanted_us = 500) noexcept {
  double s = 0, c = 0;
  const double turn = 2 * std::numbers::pi / period_us;
  for (const double age : ages_us) {
    s += std::sin(turn * age);
    c += std::cos(turn * age);
  }
  if (s == 0 && c == 0) return 0;
  const double age = std::atan2(s, c) / turn;  // in (−period/2, period/2]
  const double shift = age - wanted_us;        // an older state than wanted: send later
  return shift <= -0.5 * period_us ? shift + period_us : shift;
}

// A client that awaits its answer within the slot leaves as much for that as for a late state: an answer
// takes 0.2 ms from the tick. Shifts the grid while the device is being armed, in at most three rounds, never
// while force is felt.
class PhaseLock {
 public:
  // A force that answers state `number` for the first time.
  void heard(std::uint64_t number, double age_us, bool arming) noexcept {
    if (!arming) count_ = rounds_ = 0;
    if (!arming || rounds_ == most_rounds || count_ == ages_.size() || number < since_ || !(age_us >= 0))
      return;
    ages_[count_++] = age_us;
  }

  // What the grid is to be moved by before state `next_number` is sent; never negative.
  std::int64_t take_shift_ns(std::uint64_t next_number) noexcept {
    if (count_ < ages_.size()) return 0;
    const double shift = phase_shift_us(ages_, period_us, wanted_us);
    count_ = 0;
    since_ = next_number + 5;
    if (std::abs(shift) < tolerance_us) {
      rounds_ = most_rounds;
      return 0;
    }
    ++rounds_;
    return std::llround(1e3 * (shift < 0 ? shift + period_us : shift));
  }

 private:
  static constexpr int most_rounds = 3;
  static constexpr double period_us = 1000, wanted_us = 450, tolerance_us = 75;

  std::array<double, 40> ages_{};  // three rounds of them while a daemon arms (150 ms)
  std::size_t count_ = 0;
  int rounds_ = 0;
  std::uint64_t since_ = 0;
};

}  // namespace hapticd
