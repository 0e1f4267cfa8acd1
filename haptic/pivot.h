// A shaft that passes through a fixed point, an incision or a trocar, wherever the tip is.
//
//   u = v/|v|,  v = point − p;  where v·n < 1 mm, v ← v + (1 mm − v·n) n   (n: axis, out of the body)
//   q = s q_stylus,  s the least rotation that takes the stylus's axis z to u
//   f += N (u × (τ − z (u·τ)/(1 + z·u)))/|v|,   τ ← (z + u)(u·τ)/(1 + z·u)
//
// For devices whose stylus does not pass through it: the shaft's direction is taken from the tip's place, the
// roll about it from the stylus. The wrench is pulled back by the transpose of the map's derivative, so that
// the hand's work is the instrument's; N = I, and I − n nᵀ where v was raised: a tip that is drawn out keeps
// pointing in. Units: m, N, N·m; scene axes. Guarantee: wait-free, no allocation; a stylus that points
// against the shaft (z = −u) is turned over its x axis, and its torque about the shaft is zero. Source:
// minimal-rotation (parallel) transport of a frame; virtual work.
#pragma once

#include "physics/types.h"

namespace hapticd {

struct Pivot {
  Vec3 point = Vec3::Zero();  // [m]
  Vec3 axis = Vec3::UnitZ();  // unit, out of the body
};

// stylus: where the device's map puts the instrument.
Pose through_pivot(const Pivot& pivot, const Pose& stylus) noexcept;

// A wrench on the instrument, about its tip, as one on the stylus.
Vec6 on_stylus(const Pivot& pivot, const Pose& stylus, const Vec6& wrench) noexcept;

}  // namespace hapticd
