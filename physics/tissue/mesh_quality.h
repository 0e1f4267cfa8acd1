// What a tetrahedral mesh is like before anything is computed on it: shapes, sizes, boundary, pieces.
//
//   mean ratio  η = 12 (3 V)^⅔ / Σ l²,   0 < η ≤ 1: 1 for the regular tetrahedron, 0 for a flat one
//
// The condition number of an element's stiffness grows as η falls; below 0.1 an element is a sliver.
// Units: m, m², m³, degrees. Contract: positive tetrahedra (mesh.h). Errors: std::invalid_argument for a face
// that more than two tetrahedra share (BoundarySurface).
// Source: Liu and Joe, "Relationship between tetrahedron shape measures", BIT 34 (1994) 268.
#pragma once

#include <array>
#include <vector>

#include "physics/tissue/mesh.h"

namespace hapticd {

// The least sine of the six dihedral angles, over the regular tetrahedron's 2√2/3: 1 for that, small where an
// angle is near 0 or π, negative for a negative tetrahedron.
double dihedral_quality(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) noexcept;

double mean_ratio(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) noexcept;

struct Span {
  double least = 0, mean = 0, greatest = 0;
};

struct MeshQuality {
  std::array<int, 10> histogram{};  // of η, in tenths
  Span ratio;                       // η
  Span edge;                        // [m], each once
  Span surface_edge;                // [m], of the boundary
  Span dihedral;                    // degrees
  Span volume;                      // per tetrahedron [m³]
  double total_volume = 0;          // [m³]
  int slivers = 0;                  // η < 0.1
  int boundary_faces = 0;
  int boundary_nodes = 0;
  double boundary_area = 0;  // [m²]
  int shells = 0;            // connected pieces of the boundary: a cavity is one more
  int open_edges = 0;        // shared by another number of boundary faces than two: pinched there
  int pieces = 0;            // connected by nodes
  Vec3 low = Vec3::Zero(), high = Vec3::Zero();  // bounding box [m]

  double diagonal() const noexcept { return (high - low).norm(); }
};

MeshQuality measure_mesh(const TetMesh& mesh);

// Node that stands for the connected piece of each node.
std::vector<int> pieces_of(const TetMesh& mesh);

}  // namespace hapticd
