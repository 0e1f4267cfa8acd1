// Signed distance of two placed primitives, its normal and the nearest points.
//
//   distance = max over |n| = 1 of (min over b of n·x − max over a of n·x),   normal = argmax
//   on_b − on_a = distance · normal
//
// Units: m, world axes. The poses are those of the instruments. distance < 0: the least translation that
// parts them. Exact while the cores are apart: a sphere's centre, a capsule's segment; cylinder and convex
// are cores themselves. Deeper, a local maximum (core_distance.h): to a fifth of the smaller inner radius
// nearly always the global one. Where several places of axes are nearest (parallel capsules, cylinders side
// by side) the points are the middle of those within τ = (r_a + r_b)/100 of the least, so that they move
// continuously: at most √(2 τ (distance + r)) + τ off the true ones. Departure: of flat on flat and of a
// hull's edges and faces the points are any nearest ones. Guarantee: wait-free, no allocation, bounded. Where
// the normal is not unique (equal centres) it is some unit vector.
#pragma once

#include "physics/contact/instrument.h"

namespace hapticd {

struct PrimitiveGap {
  double distance;
  Vec3 normal;  // unit, from a to b
  Vec3 on_a, on_b;
};

PrimitiveGap gap_between(const Primitive& a, const Pose& X_a, const Primitive& b, const Pose& X_b) noexcept;

// A cheap question before it: false only where the two are farther apart than `reach`.
bool near(const Primitive& a, const Pose& X_a, const Primitive& b, const Pose& X_b, double reach) noexcept;

}  // namespace hapticd
