// All instruments of a world, each at its pose (placed_instrument.h); those not present are nowhere.
//
// Units: m. Guarantee: wait-free, no allocation. The instruments must outlive it.
#pragma once

#include <optional>

#include "physics/contact/instruments.h"
#include "physics/contact/placed_instrument.h"

namespace hapticd {

class PlacedInstruments {
 public:
  PlacedInstruments(Instruments instruments, const InstrumentPoses& X) noexcept {
    for (; count_ < instruments.count(); ++count_)
      if (X.present[count_])
        placed_[static_cast<std::size_t>(count_)].emplace(instruments[count_], X[count_]);
  }

  int count() const noexcept { return count_; }
  // Null: not present.
  const PlacedInstrument* at(int i) const noexcept {
    const auto& placed = placed_[static_cast<std::size_t>(i)];
    return placed ? &*placed : nullptr;
  }
  // Whether any is so near.
  bool near(const Vec3& x, double reach) const noexcept {
    for (int i = 0; i < count_; ++i)
      if (at(i) && at(i)->near(x, reach)) return true;
    return false;
  }
  // Of the nearest; infinite where there is none.
  Gap gap(const Vec3& x) const noexcept {
    Gap nearest{std::numeric_limits<double>::infinity(), Vec3::UnitZ(), -1};
    for (int i = 0; i < count_; ++i)
      if (at(i))
        if (const Gap gap = at(i)->gap(x); gap.distance < nearest.distance) nearest = gap;
    return nearest;
  }

 private:
  std::array<std::optional<PlacedInstrument>, max_instruments> placed_;
  int count_ = 0;
};

}  // namespace hapticd
