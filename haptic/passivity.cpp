#include "haptic/passivity.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double reach = 5e-3;    // ℓ: a linear spring that is pressed by twice of it gives all back [m]
constexpr double radius = 10e-3;  // r: a turn of 1 rad counts as so much of a way [m]
constexpr double filter_time = 5e-3;  // as the watchdog's velocity [s]
// What is lent, for with nothing no force would begin; less by what is owed, but a hundredth always [J].
constexpr double least = 0.5e-6;
constexpr double lightest = 0.05;  // that is held in a hand [kg]

struct Speed {
  Vec3 way, turn;  // [m/s, rad/s]
};

constexpr double least_speed = 1e-6;  // √S of a hand at rest [m/s]

// The wrench less what it would give beyond `tank` within h, along the motion.
Wrench within_tank(double tank, const Wrench& wrench, const Speed& v, double damping, double h) noexcept {
  const double S = v.way.squaredNorm() + radius * radius * v.turn.squaredNorm();
  const double P = wrench.force.dot(v.way) + wrench.torque.dot(v.turn);
  const double beyond = P * h - tank;
  if (beyond <= 0 || S < least_speed * least_speed) return wrench;
  const double a = std::min(beyond / (h * S), std::max(0.0, P) / S + damping);
  return wrench - Wrench{a * v.way, a * radius * radius * v.turn};
}

}  // namespace

void observe(PassivityState& state, const Pose& pose, const Wrench& displayed, double period,
             double granted) noexcept {
  if (state.has_pose) {
    const Vec6 motion = difference(pose, state.pose);
    const double work = -displayed.force.dot(motion.head<3>()) - displayed.torque.dot(motion.tail<3>());
    state.energy += work;
    const double size = displayed.force.norm() + displayed.torque.norm() / radius;
    state.tank = std::min(state.tank + work, size * reach) + granted;
    state.moved = motion;
    state.turning += (motion.tail<3>() / period - state.turning) * (period / (period + filter_time));
  }
  state.pose = pose;
  state.has_pose = true;
}

Wrench passive(const PassivityState& state, const Wrench& wrench, const Vec3& velocity,
               const DeviceSettings& device, double period) noexcept {
  const double h =
      period + (device.max_force_rate > 0 ? wrench.force.norm() / (2 * device.max_force_rate) : 0);
  // At rest, by what it would give to the lightest of hands.
  const double push = wrench.force.norm() * h, given = push * push / (2 * lightest);
  const double lent = std::max(0.01 * least, least + std::min(0.0, state.tank));
  const double share = std::min(1.0, std::sqrt(std::max(lent, state.tank) / std::max(given, lent)));
  // By the smooth velocity, and by the newest motion, which a hand that is flung away has first.
  const Wrench allowed =
      within_tank(state.tank, share * wrench, {velocity, state.turning}, device.damping, h);
  return within_tank(state.tank, allowed, {state.moved.head<3>() / period, state.moved.tail<3>() / period}, 0,
                     h);
}

}  // namespace hapticd
