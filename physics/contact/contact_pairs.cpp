#include "physics/contact/contact_pairs.h"

#include <algorithm>

namespace hapticd {
namespace {

constexpr double same_normal = 1 - 1e-12;  // cosine

// a before b in the instrument, or nearer by more than rounding.
bool implies(const Gap& a, const Gap& b) noexcept {
  if (!(a.normal.dot(b.normal) > same_normal)) return false;
  return a.primitive < b.primitive ? a.distance <= b.distance + same_gap : a.distance < b.distance - same_gap;
}

bool nearer(const Gap& a, const Gap& b) noexcept { return a.distance < b.distance; }

}  // namespace

GapsInReach::GapsInReach(const PlacedInstrument& instrument, const Vec3& x, double reach) noexcept {
  for (std::size_t k = 0; k < instrument.primitives(); ++k) {
    if (!instrument.near(k, x, reach)) continue;
    const Gap gap = instrument.gap(k, x);
    if (gap.distance < reach) add(gap);
  }
}

void GapsInReach::add(const Gap& gap) noexcept {
  if (std::any_of(begin(), end(), [&](const Gap& kept) { return implies(kept, gap); })) return;
  const auto first = gap_.begin();
  count_ = static_cast<int>(
      std::remove_if(first, first + count_, [&](const Gap& kept) { return implies(gap, kept); }) - first);
  if (count_ == most_pairs) {
    const auto farthest = std::max_element(first, first + count_, nearer);
    if (!nearer(gap, *farthest)) return;
    std::copy(farthest + 1, first + count_, farthest);
    --count_;
  }
  gap_[static_cast<std::size_t>(count_++)] = gap;
}

}  // namespace hapticd
