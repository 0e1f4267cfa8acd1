// From a recording's frame to the device's.
//
//   p_device = scale · (p − c),   c = mean of the samples if centred, else 0
//   or, for a motion of the instrument written in scene coordinates, the inverse of device.h's map:
//   p_device = q_frameᵀ (p − origin) / position_scale,   q_device = q_frameᵀ q q_toolᵀ
//
// A recording of another device needs centring when its origin lies elsewhere in its workspace, and a scale
// only when the hand moved further than this device reaches. Orientations are kept. Units: m.
// Errors: std::invalid_argument for a scale that is not positive.
#pragma once

#include "haptic/device.h"
#include "server/record/trajectory.h"

namespace hapticd {

Trajectory centred(const Trajectory& recording);
Trajectory scaled(const Trajectory& recording, double scale);
Trajectory from_scene(const DeviceSettings& device, const Trajectory& recording);

// Largest speed between samples [m/s], what a daemon's jump limit will see.
double largest_speed(const Trajectory& recording);

}  // namespace hapticd
