// Which primitives of the instrument a tissue sample may touch, each of which then has a row of its own.
//
//   {k : sd_k(x) < reach},  without those that another implies: n_j = n_k and sd_j ≤ sd_k
//
// The union of convex primitives is not convex, so one row, of the nearest primitive, lets a solve move the
// sample into the next primitive, whose row in the next solve moves it back: a held pose would swing. With
// equal normals the row of k would be that of j with a larger gap, and is left out; of equal gaps the lower
// index stays.
// At most `most_pairs`, the nearest. Units: m. Guarantee: wait-free, no allocation, O(primitives).
#pragma once

#include <array>

#include "physics/contact/placed_instrument.h"

namespace hapticd {

inline constexpr int most_pairs = 8;      // of one sample
inline constexpr double same_gap = 1e-9;  // [m]: primitives that coincide up to rounding

// By primitive.
class GapsInReach {
 public:
  GapsInReach(const PlacedInstrument& instrument, const Vec3& x, double reach) noexcept;
  const Gap* begin() const noexcept { return gap_.data(); }
  const Gap* end() const noexcept { return gap_.data() + count_; }

 private:
  void add(const Gap& gap) noexcept;

  std::array<Gap, most_pairs> gap_;
  int count_ = 0;
};

}  // namespace hapticd
