// Where a point touches a surface of triangles: gaps and normals that do not chatter.
//
//   δ = n·(p − Σ w_c x_c),   n from the surface to the point, δ < 0 inside
//
// Nearest feature a face: its normal and its plane. Nearest feature an edge or a corner, seen from outside:
// n = (p − c)/‖p − c‖, and the angle-weighted pseudo-normal there once p is as near as `same_place` (the
// direction to a point that nearly lies on an edge turns at random); seen from inside: the face's plane. The
// pseudo-normal also gives the sign, which is right wherever the nearest feature is right.
// Hysteresis: a face that held the point in the last solve still does while the point's projection is no more
// than 2 % outside of it. Without it a point that grazes an edge is now on the face, now beyond, and no
// linearisation is the last.
// Hollows: where faces meet concavely, free space is the intersection of their half spaces, and a point that
// settles in the hollow needs them all, or it is pushed from one to the other for ever. So a face that sees
// p's projection (enlarged by a quarter) and lies in front of the nearest one, as that one lies in front of
// it, is a touch of its own. Faces that turn less than 0.8° from one another are one.
// Units: m. Guarantee: wait-free, no allocation. Source: Bærentzen and Aanæs 2005 (pseudo-normals); Ericson,
// Real-Time Collision Detection, §5.1.5.
#pragma once

#include <array>
#include <span>

#include "physics/types.h"

namespace hapticd {

inline constexpr int max_vertex_face_contacts = 4;  // of one point

// A triangle wound outward. `edge[c]` is the pseudo-normal of the edge opposite corner c, `corner[c]` of the
// corner; unit.
struct ContactFace {
  std::array<Vec3, 3> x;
  std::array<Vec3, 3> edge;
  std::array<Vec3, 3> corner;
};

struct VertexFaceContact {
  int face;                      // into the faces given
  Vec3 normal;                   // unit
  double gap;                    // [m]
  std::array<double, 3> weight;  // of the face's corners, sums to 1; a little negative in enlarged faces
};

// Barycentric weights of the triangle's point nearest to p; a weight is exactly 0 off its feature.
std::array<double, 3> nearest_on_triangle(const Vec3& p, const std::array<Vec3, 3>& x) noexcept;

// Touches of p, the nearest face's first. `same_place` [m]: see above; `held`: the face that held p, or −1.
// Returns how many; 0 without faces.
int find_vertex_face_contacts(const Vec3& p, std::span<const ContactFace> faces, double same_place, int held,
                              std::array<VertexFaceContact, max_vertex_face_contacts>& out) noexcept;

}  // namespace hapticd
