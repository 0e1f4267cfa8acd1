#include "haptic/tuning.h"

#include <algorithm>

namespace hapticd {

DeviceTuning tuning_of(const DeviceSettings& d) noexcept {
  return {d.max_force,        d.max_torque, d.max_force_rate, d.max_speed,
          d.workspace_radius, d.damping,    d.position_scale, d.force_scale};
}

void apply(const DeviceTuning& t, DeviceSettings& d) noexcept {
  d.max_force = t.max_force;
  d.max_torque = t.max_torque;
  d.max_force_rate = t.max_force_rate;
  d.max_speed = t.max_speed;
  d.workspace_radius = t.workspace_radius;
  d.damping = t.damping;
  d.position_scale = t.position_scale;
  d.force_scale = t.force_scale;
}

DeviceTuning clamped(const DeviceTuning& wanted, const DeviceTuning& started, double coupling,
                     double stiffness) noexcept {
  DeviceTuning t = wanted;
  t.max_force = std::min(wanted.max_force, started.max_force);
  t.max_torque = std::min(wanted.max_torque, started.max_torque);
  t.max_force_rate = std::min(wanted.max_force_rate, started.max_force_rate);
  t.max_speed = std::min(wanted.max_speed, started.max_speed);
  t.workspace_radius = std::min(wanted.workspace_radius, started.workspace_radius);
  t.damping = std::min(wanted.damping, started.damping);
  // A mistyped scale moves the instrument through everything, or takes the hand out of the scene.
  constexpr double most_change = 4;
  t.position_scale = std::clamp(wanted.position_scale, started.position_scale / most_change,
                                most_change * started.position_scale);
  const double product = started.position_scale * started.force_scale;
  const double most = coupling > 0 ? std::max(stiffness / coupling, product) : product;
  if (t.position_scale * t.force_scale > most) t.force_scale = most / t.position_scale;
  return t;
}

void start_ramp(TuningRamp& ramp, const DeviceTuning& target) noexcept {
  ramp.target = target;
  ramp.left = tuning_seconds;
}

void advance(TuningRamp& ramp, DeviceSettings& d, double period) noexcept {
  if (ramp.left <= 0) return;
  // A tick more or less is rounding.
  const bool last = ramp.left < 1.5 * period;
  const double share = last ? 1 : period / ramp.left;
  ramp.left = last ? 0 : ramp.left - period;
  const auto towards = [&](double& value, double target) {
    value = last ? target : value + share * (target - value);
  };
  const DeviceTuning& t = ramp.target;
  towards(d.max_force, t.max_force);
  towards(d.max_torque, t.max_torque);
  towards(d.max_force_rate, t.max_force_rate);
  towards(d.max_speed, t.max_speed);
  towards(d.workspace_radius, t.workspace_radius);
  towards(d.damping, t.damping);
  towards(d.position_scale, t.position_scale);
  towards(d.force_scale, t.force_scale);
}

}  // namespace hapticd
