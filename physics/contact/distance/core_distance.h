// Signed distance of two convex cores (segment, cylinder, hull), known by their support functions h_A, h_B.
//
//   distance = max over |n| = 1 of  g(n) = −h_A(n) − h_B(−n),   normal = argmax   (from a to b)
//
// Apart: GJK, exact. Overlapping: a local maximum of g, found from the faces, the axes and the line of
// centres. At shallow overlaps it is the global one, but for some 0.3 % of the hulls'; always g(normal) =
// distance: moving b by −distance · normal parts the two. `on_a`, `on_b` are a pair of nearest points: any
// one where several are. Units: m, world axes. Guarantee: wait-free, no allocation; at most 25 turns of at
// most 48 supports. Source: Gilbert, Johnson, Keerthi 1988; the turns are derived in the source file.
#pragma once

#include "physics/contact/instrument.h"

namespace hapticd {

enum class CoreShape { segment, cylinder, hull };

struct Core {
  CoreShape shape;
  Mat3 R;                 // the core's axes in the world
  Vec3 origin;            // of those axes [m]
  Vec3 centre;            // a point well inside [m]
  double radius;          // cylinder [m]
  double half_length;     // segment, cylinder; along the core's z [m]
  const Primitive* hull;  // its vertices and planes, else null
};

struct CoreGap {
  double distance;
  Vec3 normal, on_a, on_b;
};

CoreGap core_gap(const Core& a, const Core& b) noexcept;

}  // namespace hapticd
