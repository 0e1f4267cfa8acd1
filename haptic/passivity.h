// Passivity observer and controller of the displayed force.
//
//   E_k = E_{k−1} − F_{k−1} · (x_k − x_{k−1}) − τ_{k−1} · θ(q_k q_{k−1}⁻¹)
//
// E [J] is the energy that the hand put into the virtual tissue less what it got back. It is exact for the
// force that the device held between two ticks. Below zero the rendering made energy. The controller, if
// switched on, adds F_pc = −α v with α = min(−E / (T ‖v‖²), b), b the damping that the device renders well.
// The observer counts F_pc in the next tick like any other force.
// Units: m, N, N·m, J, s, device frame. Guarantee: wait-free, no allocation.
// Source: Hannaford and Ryu 2002, eq. 3 and 8 (impedance causality). Departure: α is bounded, so a deficit
// at rest is paid back over several ticks instead of at once.
#pragma once

#include "haptic/limits.h"

namespace hapticd {

struct PassivityState {
  bool has_pose = false;
  Pose pose;          // at the previous tick
  double energy = 0;  // E [J]
};

// Counts the motion to `pose` under `displayed`, the wrench sent in the previous tick.
void observe(PassivityState& state, const Pose& pose, const Wrench& displayed) noexcept;

// F_pc for the deficit there is; zero when there is none.
Vec3 passivity_force(const PassivityState& state, const Vec3& velocity, double max_damping,
                     double period) noexcept;

}  // namespace hapticd
