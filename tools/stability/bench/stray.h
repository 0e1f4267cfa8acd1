// Where a hand strays: ways of minimum jerk from place to place, pedals, lost states.
//
// Every 100 to 800 ms another place, as its kind of hand chooses; one way in ten loses a burst of states. The
// same on every machine. Units: m, rad, ms.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "haptic/device.h"
#include "tools/stability/bench/lens_hand.h"

namespace hapticd {

struct StrayPlace {
  Vec3 tip = Vec3::Zero();   // in the scene
  Vec3 turn = Vec3::Zero();  // rotation vector
};

// One kind of hand.
struct StrayingHand {
  StrayPlace begin;
  std::function<StrayPlace(Chance&, const StrayPlace& from)> next;
  std::function<Quat(const StrayPlace&)> turned;  // the instrument there
  double peak_speed = 0;                          // of the tip in the scene [m/s]
};

// The first so many of the scenes cataract and two_hands: over, on or up to 1.5 mm in the lens, each through
// its own port.
std::vector<StrayingHand> lens_hands(int count);

// The blade of the scene incision: beside, over and in the block, upright within a third of a radian, any way
// round.
StrayingHand blade_hand();

// The ball of the scene cube: over, on or up to 3 mm in the cube, upright.
StrayingHand cube_hand();

class Stray {
 public:
  Stray(std::uint64_t seed, const StrayingHand& hand)
      : chance_(seed), next_(hand.next), from_(hand.begin), to_(hand.begin) {}

  void advance() {
    if (++at_ < length_) return;
    from_ = to_;
    at_ = 0;
    length_ = static_cast<int>(chance_.between(100, 800));
    to_ = next_(chance_, from_);
    buttons_ = chance_.happens(0.5) ? pedal_phaco | pedal_aspiration : 0u;
    const bool burst = chance_.happens(0.1);
    lost_from_ = burst ? static_cast<int>(chance_.between(0, 100)) : length_;
    lost_to_ = lost_from_ + static_cast<int>(chance_.between(2, 60));
  }
  StrayPlace place() const {
    const double u = static_cast<double>(at_) / length_, s = u * u * u * (10 - 15 * u + 6 * u * u);
    return {from_.tip + s * (to_.tip - from_.tip), from_.turn + s * (to_.turn - from_.turn)};
  }
  std::uint32_t buttons() const { return buttons_; }
  bool lost() const { return at_ >= lost_from_ && at_ < lost_to_; }

 private:
  Chance chance_;
  std::function<StrayPlace(Chance&, const StrayPlace&)> next_;
  StrayPlace from_, to_;
  int at_ = 0, length_ = 400, lost_from_ = 1 << 30, lost_to_ = 1 << 30;
  std::uint32_t buttons_ = 0;
};

}  // namespace hapticd
