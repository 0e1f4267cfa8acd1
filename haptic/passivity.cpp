#include "haptic/passivity.h"

#include <algorithm>

namespace hapticd {

void observe(PassivityState& state, const Pose& pose, const Wrench& displayed) noexcept {
  if (state.has_pose) {
    const Vec6 motion = difference(pose, state.pose);
    state.energy -= displayed.force.dot(motion.head<3>()) + displayed.torque.dot(motion.tail<3>());
  }
  state.pose = pose;
  state.has_pose = true;
}

Vec3 passivity_force(const PassivityState& state, const Vec3& velocity, double max_damping,
                     double period) noexcept {
  const double v2 = velocity.squaredNorm();
  if (state.energy >= 0 || v2 < 1e-12) return Vec3::Zero();
  return -std::min(-state.energy / (period * v2), max_damping) * velocity;
}

}  // namespace hapticd
