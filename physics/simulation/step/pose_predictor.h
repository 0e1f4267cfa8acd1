// Where an instrument will be in some steps: on along the circle through three of the places where it was.
//
//   a = p₀ − p₋ₘ,   b = p₋ₘ − p₋₂ₘ,   θ: the angle from b to a, about n = b × a
//   p(k) − p₀ = sin(θ k/2m) / sin(θ/2) · rot(n, θ (m + k)/2m) a,   θ → 0:  (k/m) a
//
// a is a chord of m steps, and what is asked for the chord of k steps that follows it: a hand that sculpts
// goes in curves, and a straight line would have left them by the time that a reference factor takes to make.
// Where the two chords make more than a right angle it turned back, and no circle says where it will go:
// straight on. Units: m. Guarantee: wait-free, no allocation.
#pragma once

#include <array>

#include "physics/types.h"

namespace hapticd {

class PosePredictor {
 public:
  void forget() noexcept { count_ = 0; }
  // Once in a step.
  void follow(const Vec3& p) noexcept;

  // p(steps) − p₀, by chords of at most `chord` steps; zero while fewer than two places are known.
  Vec3 in(double steps, int chord) const noexcept;

 private:
  static constexpr int most_chord = 16;
  static constexpr int capacity = 2 * most_chord + 1;

  // So many steps ago.
  const Vec3& before(int steps) const noexcept { return p_[(newest_ - steps + capacity) % capacity]; }

  std::array<Vec3, capacity> p_;
  int newest_ = 0;
  int count_ = 0;
};

}  // namespace hapticd
