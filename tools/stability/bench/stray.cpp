#include "tools/stability/bench/stray.h"

#include <algorithm>

namespace hapticd {
namespace {

StrayPlace about_lens(Chance& chance, const StrayPlace&) {
  const double x = chance.between(-1.5e-3, 1.5e-3), y = chance.between(-1.6e-3, 1.2e-3);
  return {over_lens(x, y, chance.between(-0.8e-3, 1.5e-3))};
}

// The block is 24 × 12 × 10 mm on z = 0, the tip the lower end of an upright edge of 8 mm that cuts along x.
StrayPlace about_block(Chance& chance, const StrayPlace& from) {
  const Vec3 least(-17e-3, -9e-3, 2e-3), most(17e-3, 9e-3, 13e-3);
  constexpr double farthest = 5e-3, most_turn = 0.4, most_tilt = 0.3;
  StrayPlace place = from;
  for (int c = 0; c < 3; ++c) {
    place.tip[c] = std::clamp(from.tip[c] + chance.between(-farthest, farthest), least[c], most[c]);
    place.turn[c] += chance.between(-most_turn, most_turn);
    if (c < 2) place.turn[c] = std::clamp(place.turn[c], -most_tilt, most_tilt);
  }
  return place;
}

// The cube is 20 mm wide and high, on z = 0, the ball's radius 3 mm.
StrayPlace about_cube(Chance& chance, const StrayPlace&) {
  const double x = chance.between(-6e-3, 6e-3), y = chance.between(-6e-3, 6e-3);
  return {Vec3(x, y, 23e-3 - chance.between(-2e-3, 3e-3)), Vec3::Zero()};
}

Quat turned_by(const StrayPlace& place) {
  const double angle = place.turn.norm();
  return angle > 0 ? Quat(Eigen::AngleAxisd(angle, place.turn / angle)) : Quat::Identity();
}

}  // namespace

std::vector<StrayingHand> lens_hands(int count) {
  std::vector<StrayingHand> hands;
  for (int i = 0; i < count; ++i)
    hands.push_back(
        {{over_lens(-1.5e-3 * i, -0.6e-3, -0.5e-3)},
         about_lens,
         [i](const StrayPlace& at) { return i == 0 ? through_incision(at.tip) : through_side_port(at.tip); },
         80e-3});  // 4 mm in 100 ms, minimum jerk
  return hands;
}

StrayingHand cube_hand() { return {{Vec3(0, 0, 25e-3), Vec3::Zero()}, about_cube, turned_by, 0.31}; }

StrayingHand blade_hand() {
  return {{Vec3(-18e-3, 0, 6e-3), Vec3::Zero()}, about_block, turned_by, 0.17};  // 9 mm in 100 ms
}

}  // namespace hapticd
