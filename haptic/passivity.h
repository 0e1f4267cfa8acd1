// Passivity observer and controller of the force that is displayed.
//
//   E_k = E_{k−1} − F_{k−1} · (x_k − x_{k−1}) − τ_{k−1} · θ(q_k q_{k−1}⁻¹)
//
// E [J] is what the hand put into the virtual tissue less what it got back; a sample-and-hold makes
// it exact for the force that the device held. E < 0: the rendering made energy. The controller,
// if switched on, then adds F_pc = −α v with α = min(−E / (T ‖v‖²), b), b the damping that the
// device renders well; the observer counts it in the next tick like any other force.
// Units: m, N, N·m, J, s, device frame. Guarantee: wait-free, no allocation.
// Source: Hannaford and Ryu 2002, eq. 3 and 8 (impedance causality). Departure: α is bounded, so a
// deficit at rest is paid back over several ticks instead of as one kick.
#pragma once

#include "haptic/limits.h"

namespace hapticd {

struct PassivityState {
  bool has_pose = false;
  Pose pose;           // at the previous tick
  double energy = 0;   // E [J]
};

// Counts the motion to `pose` under `displayed`, the wrench sent in the previous tick.
void observe(PassivityState& state, const Pose& pose, const Wrench& displayed) noexcept;

// F_pc for the deficit there is; zero when there is none.
Vec3 passivity_force(const PassivityState& state, const Vec3& velocity, double max_damping,
                     double period) noexcept;

}  // namespace hapticd
