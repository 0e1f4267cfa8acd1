// Surfaces that contact solvers are measured on: a dense compliance of finite elements and points of
// material.
//
//   s = Σ w_a x_a,   C = (M/h² + B/h + K)⁻¹ between the surface's nodes, at rest (h = 20 ms, E = 3 kPa, ν =
//   0.45)
//
// lens: around the anterior pole of the cataract scene's lens. block: the upper face of a box of 8 × 8 × 6
// mm. pair: two such lenses 4 mm apart, which do not feel one another. rigid: points of a plane, no
// compliance. Units: m, m/N. Shapes: C is (3·nodes)², node-wise interleaved. Errors: InputError for a missing
// mesh.
#pragma once

#include <array>
#include <vector>

#include "physics/types.h"

namespace hapticd {

struct SurfacePoint {
  std::array<int, 3> node;  // node[0] < 0: fixed
  std::array<double, 3> weight;
  Vec3 fixed;
};

struct ContactSurface {
  std::vector<Vec3> x;  // free positions of the nodes
  MatX C;
  std::vector<SurfacePoint> points;
  Vec3 centre = Vec3::Zero();  // where strokes are centred, on the surface
};

// per_triangle: points along each edge's direction, k² in a triangle.
ContactSurface lens_surface(int per_triangle);
ContactSurface block_surface(int cells, int per_triangle);
ContactSurface pair_of(const ContactSurface& surface, double apart);
ContactSurface rigid_plane(double side, int per_side);
// Every point `times` times, in the same place.
ContactSurface repeated(const ContactSurface& surface, int times);

}  // namespace hapticd
