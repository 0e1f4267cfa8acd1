// The instrument at one pose, asked about many points: the same gap, and a cheap question before it.
//
//   x_local,k = R_kᵀ (x − p_k),   (R_k, p_k) = X · placement_k as a matrix, once per pose
//
// `near` compares squares against primitives grown by the reach: no root, no division, no normal. It is false
// only where every primitive is farther than `reach`; where it is true, `gap` has the last word.
// Units: m. Departure from gap_at(instrument, X, x): round-off. Guarantee: wait-free, no allocation, bounded
// by the number of primitives. The instrument must outlive it.
#pragma once

#include <array>
#include <limits>

#include "physics/contact/instrument.h"

namespace hapticd {

class PlacedInstrument {
 public:
  PlacedInstrument(const Instrument& instrument, const Pose& X) noexcept;

  Gap gap(const Vec3& x) const noexcept;
  bool near(const Vec3& x, double reach) const noexcept;

  // Of primitive k alone.
  Gap gap(std::size_t k, const Vec3& x) const noexcept;
  bool near(std::size_t k, const Vec3& x, double reach) const noexcept;
  // How thick it is: half of its least width, where that is known; else infinity [m].
  double radius(std::size_t k) const noexcept {
    const Primitive& p = instrument_.primitives[k];
    return p.shape == Shape::convex ? std::numeric_limits<double>::infinity() : p.radius;
  }
  std::size_t primitives() const noexcept { return instrument_.primitives.size(); }

 private:
  struct Placed {
    Mat3 world_to_local;
    Vec3 p;
    Shape shape;
    double radius, half_length;
  };
  // An instrument of more primitives is asked as a whole.
  static constexpr std::size_t capacity = 16;

  bool within(std::size_t k, const Vec3& x, double reach) const noexcept;

  const Instrument& instrument_;
  Pose X_;
  std::size_t count_;  // of those placed: all, or 0
  std::array<Placed, capacity> placed_;
};

}  // namespace hapticd
