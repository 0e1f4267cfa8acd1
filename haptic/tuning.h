// Changes of a device's limits and scales while it is in a hand: within what it started with, and ramped.
//
//   clamped   every limit ≤ the one that the device started with;
//             position_scale · force_scale ≤ max(stiffness / K_vc, the product that it started with)
//   ramp      x(t) = x₀ + (x₁ − x₀) min(1, t / 1 s)   for every value, in equal parts per tick
//
// For a force scale from s₀ to s₁ a tick of the ramp changes a steady force F by at most |s₁ − s₀| / s₀ · F
// / 1000, and the slew limit follows. A position scale moves the instrument by |s₁ − s₀| |p| in that second,
// which is felt like a motion of the hand. A new target during a ramp starts from the present values.
// Units: as DeviceSettings. Guarantee: wait-free, no allocation.
#pragma once

#include "haptic/device.h"

namespace hapticd {

struct DeviceTuning {
  double max_force = 0;
  double max_torque = 0;
  double max_force_rate = 0;
  double max_speed = 0;
  double workspace_radius = 0;
  double damping = 0;
  double position_scale = 1;
  double force_scale = 1;

  bool operator==(const DeviceTuning&) const = default;
};

DeviceTuning tuning_of(const DeviceSettings& device) noexcept;
void apply(const DeviceTuning& tuning, DeviceSettings& device) noexcept;  // at once

// coupling: K_vc [N/m]; stiffness: the largest that the device displays stably [N/m].
DeviceTuning clamped(const DeviceTuning& wanted, const DeviceTuning& started, double coupling,
                     double stiffness) noexcept;

inline constexpr double tuning_seconds = 1;

struct TuningRamp {
  DeviceTuning target;
  double left = 0;  // [s]; 0: the target is reached
};

void start_ramp(TuningRamp& ramp, const DeviceTuning& target) noexcept;
void advance(TuningRamp& ramp, DeviceSettings& device, double period) noexcept;

}  // namespace hapticd
