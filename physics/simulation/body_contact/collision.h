// Which surface triangles the instruments can reach: broad and narrow phase at the simulation's rate.
//
// Broad phase: an axis-aligned box around each surface triangle, refitted every step, and looked at one after
// another: a body has some thousands, and what a tree would save is less than it costs to build it anew where
// an element goes. Narrow phase: each primitive grown by the alarm distance against the triangle (exact for
// spheres, capsules and cylinders by FCL and libccd; the bounding box of a convex mesh, whose samples are
// measured exactly later).
// Units: m. Errors: std::runtime_error where a face is not a number, or a thousand times wider than the
// body's widest was at first: tissue that has come to that is unstable, and libccd might never answer.
// Allocates: for the simulation thread only.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "physics/contact/instruments.h"
#include "physics/tissue/surface.h"

namespace hapticd {

struct NearFace {
  int body;
  int face;  // index into the faces that `set_surface` was given
};

class Collision {
 public:
  Collision(Instruments instruments, double alarm_distance);
  ~Collision();
  Collision(const Collision&) = delete;
  Collision& operator=(const Collision&) = delete;

  // Bodies are numbered in the order they are added; positions are per mesh node.
  int add_body(std::span<const SurfaceFace> faces, std::span<const Vec3> positions);

  // After a removal: new triangles.
  void set_surface(int body, std::span<const SurfaceFace> faces, std::span<const Vec3> positions);

  // Same triangles, moved.
  void refit(int body, std::span<const Vec3> positions);

  // Faces within the alarm distance of those present at X, sorted by body and face, unique.
  void near_faces(const InstrumentPoses& X, std::vector<NearFace>& out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hapticd
