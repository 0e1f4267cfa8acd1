// The limits between any computed force and a hand: finite check, saturation, slew limit, blend; and a ghost,
// which is bounded by itself.
//
//   saturation   F ← F · min(1, F_max / ‖F‖)                      direction kept
//   slew         F ← F_last + ΔF · min(1, Ḟ_max T / ‖ΔF‖)         per tick sent, whatever time passed
//   ghost        F = k d · min(1, F_g / ‖k d‖),  d = q_frameᵀ (p_other − p) / position_scale
//   blend        F ← F + (F_before − F) · (1 − (t + T)/(5 ms + T))  after a removal or a stall
//
// The segment between two points of the ball ‖F‖ ≤ F_max lies in the ball, so slew after saturation obeys
// both. Torque has the same limits with τ_max and the slew Ḟ_max τ_max / F_max (equal time to full scale).
// Units: N, N·m, s, device frame. Guarantee: wait-free, no allocation.
#pragma once

#include "haptic/device.h"

namespace hapticd {

inline Wrench operator+(const Wrench& a, const Wrench& b) noexcept {
  return {a.force + b.force, a.torque + b.torque};
}
inline Wrench operator-(const Wrench& a, const Wrench& b) noexcept {
  return {a.force - b.force, a.torque - b.torque};
}
inline Wrench operator*(double s, const Wrench& w) noexcept { return {s * w.force, s * w.torque}; }

bool is_finite(const Wrench& w) noexcept;

// hit: set to true when a limit applied, else left unchanged.
Wrench saturated(const DeviceSettings& device, const Wrench& w, bool& hit) noexcept;
Wrench slew_limited(const DeviceSettings& device, const Wrench& last, const Wrench& w, double period,
                    bool& hit) noexcept;

// An earlier force that gives way linearly to the present one.
struct Blend {
  Wrench from;
  double left = 0;  // 1 → 0
  double time = 0;  // [s]
};

// From this hand's tip to the other's, both in the scene; zero without a ghost.
Vec3 ghost_force(const DeviceSettings& device, const Vec3& own, const Vec3& other) noexcept;

// From now on the force goes over from `last`; a blend under way is replaced, and keeps the time that it had
// left if it was a longer one.
void start_blend(Blend& blend, const Wrench& last, double duration) noexcept;

// The blended wrench; one period further each call, none left `duration` after the first.
Wrench blended(Blend& blend, const Wrench& fresh, double period) noexcept;

}  // namespace hapticd
