#include "physics/simulation/step/pose_predictor.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace hapticd {

void PosePredictor::follow(const Vec3& p) noexcept {
  newest_ = (newest_ + 1) % capacity;
  p_[newest_] = p;
  count_ = std::min(count_ + 1, capacity);
}

Vec3 PosePredictor::in(double steps, int chord) const noexcept {
  if (count_ < 2) return Vec3::Zero();
  const int m = std::clamp(chord, 1, std::min(most_chord, std::max(1, (count_ - 1) / 2)));
  const Vec3 a = before(0) - before(m);
  const Vec3 straight = steps / m * a;
  if (count_ < 2 * m + 1) return straight;
  const Vec3 b = before(m) - before(2 * m);
  const Vec3 n = b.cross(a);
  const double theta = std::atan2(n.norm(), b.dot(a));
  constexpr double least = 1e-3, right_angle = 1.5707963267948966;  // [rad]
  if (!(theta > least) || !(theta < right_angle)) return straight;
  const double half = theta / (2 * m);
  return std::sin(half * steps) / std::sin(half * m) *
         (Eigen::AngleAxisd(half * (m + steps), n.normalized()) * a);
}

}  // namespace hapticd
