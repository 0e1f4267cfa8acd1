#include "haptic/limits.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

Vec3 within(const Vec3& v, double radius, bool& hit) noexcept {
  const double norm = v.stableNorm();  // does not overflow on forces that are finite and absurd
  if (norm <= radius) return v;
  hit = true;
  return v * (std::max(radius, 0.0) / norm);
}

}  // namespace

bool is_finite(const Wrench& w) noexcept { return w.force.allFinite() && w.torque.allFinite(); }

Wrench saturated(const DeviceSettings& device, const Wrench& w, bool& hit) noexcept {
  // A 3-DoF device (max_torque 0) is not saturated by a torque that it never sees.
  bool unseen = false;
  return {within(w.force, device.max_force, hit),
          within(w.torque, device.max_torque, device.max_torque > 0 ? hit : unseen)};
}

Wrench slew_limited(const DeviceSettings& device, const Wrench& last, const Wrench& w, double period,
                    bool& hit) noexcept {
  const double step = device.max_force_rate * period;
  const double torque_step = device.max_force > 0 ? step * device.max_torque / device.max_force : 0;
  const Wrench change = w - last;
  return {last.force + within(change.force, step, hit),
          last.torque + within(change.torque, torque_step, hit)};
}

Vec3 ghost_force(const DeviceSettings& d, const Vec3& own, const Vec3& other) noexcept {
  if (!d.ghost) return Vec3::Zero();
  bool bounded = false;
  const Vec3 pull = d.ghost->stiffness / d.position_scale * (d.frame.conjugate() * (other - own));
  return within(pull, d.ghost->max_force, bounded);
}

void start_blend(Blend& blend, const Wrench& last, double duration) noexcept {
  blend.time = duration < blend.time && blend.left > 0 ? blend.left * blend.time : duration;
  blend.from = last;
  blend.left = 1;
}

Wrench blended(Blend& blend, const Wrench& fresh, double period) noexcept {
  if (blend.left <= 0) return fresh;
  blend.left -= period / (blend.time + period);
  if (blend.left < 1e-9) blend.left = 0;
  return fresh + blend.left * (blend.from - fresh);
}

}  // namespace hapticd
