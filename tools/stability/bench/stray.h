// Where a hand strays over the cataract scene's lens: ways of minimum jerk from place to place, pedals, lost
// states.
//
// Every 100 to 800 ms another place over, on or up to 1.5 mm in the lens; one way in ten loses a burst of
// states. The same on every machine. Units: m, ms.
#pragma once

#include "haptic/device.h"
#include "tools/stability/bench/lens_hand.h"

namespace hapticd {

class Stray {
 public:
  explicit Stray(std::uint64_t seed, const Vec3& begin = over_lens(0, -0.6e-3, -0.5e-3))
      : chance_(seed), from_(begin), to_(begin) {}

  void advance() {
    if (++at_ < length_) return;
    from_ = to_;
    at_ = 0;
    length_ = static_cast<int>(chance_.between(100, 800));
    const double x = chance_.between(-1.5e-3, 1.5e-3), y = chance_.between(-1.6e-3, 1.2e-3);
    to_ = over_lens(x, y, chance_.between(-0.8e-3, 1.5e-3));
    buttons_ = chance_.happens(0.5) ? pedal_phaco | pedal_aspiration : 0u;
    const bool burst = chance_.happens(0.1);
    lost_from_ = burst ? static_cast<int>(chance_.between(0, 100)) : length_;
    lost_to_ = lost_from_ + static_cast<int>(chance_.between(2, 60));
  }
  Vec3 tip() const {
    const double u = static_cast<double>(at_) / length_;
    return from_ + u * u * u * (10 - 15 * u + 6 * u * u) * (to_ - from_);
  }
  std::uint32_t buttons() const { return buttons_; }
  bool lost() const { return at_ >= lost_from_ && at_ < lost_to_; }

 private:
  Chance chance_;
  Vec3 from_, to_;
  int at_ = 0, length_ = 400, lost_from_ = 1 << 30, lost_to_ = 1 << 30;
  std::uint32_t buttons_ = 0;
};

}  // namespace hapticd
