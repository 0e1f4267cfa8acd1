// A tetrahedral mesh with named physical groups, as values.
//
// Units: m. Node and tetrahedron indices are zero-based and dense. A tetrahedron (a,b,c,d) is
// positive: det[b−a, c−a, d−a] > 0.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "physics/types.h"

namespace hapticd {

using Tet = std::array<int, 4>;
using Triangle = std::array<int, 3>;
inline constexpr Tet no_tet = {-1, -1, -1, -1};  // a place that is not in use

// A named physical group: the nodes of all its entities, and its tetrahedra where it has any.
struct MeshGroup {
  std::string name;
  std::vector<int> nodes;  // sorted, unique
  std::vector<int> tets;   // sorted, unique
};

struct TetMesh {
  std::vector<Vec3> nodes;
  std::vector<Tet> tets;
  std::vector<MeshGroup> groups;

  const MeshGroup* group(const std::string& name) const noexcept {
    for (const MeshGroup& g : groups)
      if (g.name == name) return &g;
    return nullptr;
  }
};

// Signed volume of a tetrahedron [m³].
inline double signed_volume(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) noexcept {
  return (b - a).cross(c - a).dot(d - a) / 6.0;
}

// The triangle opposite to corner `face` of a positive tetrahedron, wound outward.
inline Triangle outward_face(const Tet& t, int face) noexcept {
  static constexpr int corner[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
  return {t[corner[face][0]], t[corner[face][1]], t[corner[face][2]]};
}

}  // namespace hapticd
