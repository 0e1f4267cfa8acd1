// Passivity observer and energy tank of the displayed force.
//
//   w   = −F_{k−1} · (x_k − x_{k−1}) − τ_{k−1} · θ(q_k q_{k−1}⁻¹)          what the hand puts in
//   E_k = E_{k−1} + w,    T_k = min(T_{k−1} + w, ‖F_{k−1}‖ ℓ)
//
// E [J] is exact for the force that the device held between two ticks; below zero the rendering made energy.
// T is what the tissue may give back: no more than the present force over ℓ, so that what friction or a cut
// has taken is no credit; what a pump is about to do is granted. The controller keeps T from going below
// zero: what would go to the hand beyond T while the force falls by its slew limit, h, is taken out of it
// along the motion, and a deficit is paid back by damping of at most b:
//   (F, τ) −= a (v, r² ω),   a = min((P h − T)/(h S), max(0, P)/S + b),   P = F·v + τ·ω,  S = v² + r² ω²
// Of a hand at rest the force is at most what gives T, or 0.5 µJ that are lent, to m = 50 g:
//   ‖F‖² h² ≤ 2 m T
// Units: SI, device frame. Guarantee: wait-free, no allocation. Source: Hannaford and Ryu 2002, eq. 3 and 8;
// tank: Franken et al. 2011. Departures: the tank's size follows the force; the damping is bounded, so a
// deficit is paid back over several ticks; what is lent.
#pragma once

#include "haptic/limits.h"

namespace hapticd {

struct PassivityState {
  bool has_pose = false;
  Pose pose;                    // at the previous tick
  Vec3 turning = Vec3::Zero();  // ω, low-passed as the watchdog's velocity [rad/s]
  Vec6 moved = Vec6::Zero();    // in the last tick
  double energy = 0;            // E [J]
  double tank = 0;              // T [J]
};

// Counts the motion to `pose` under `displayed`, the wrench sent in the previous tick. granted: energy that
// comes from elsewhere meanwhile [J].
void observe(PassivityState& state, const Pose& pose, const Wrench& displayed, double period,
             double granted = 0) noexcept;

// The wrench as the tank allows it.
Wrench passive(const PassivityState& state, const Wrench& wrench, const Vec3& velocity,
               const DeviceSettings& device, double period) noexcept;

}  // namespace hapticd
