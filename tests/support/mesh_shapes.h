// Structured tetrahedral meshes for tests: exact sizes, exact counts, a group 'bottom' at z = 0.
//
// Units: m. Every tetrahedron is positive. Boxes have a corner at the origin.
#pragma once

#include <cstdint>

#include "physics/tissue/mesh.h"

namespace hapticd {

// A box of nx × ny × nz cells, each split in 6 tetrahedra (all alike) or 5 (mirrored from cell to cell).
// Nodes: x runs fastest, then y, then z. Throws std::invalid_argument for another split or a count < 1.
TetMesh box_mesh(const Vec3& size, int nx, int ny, int nz, int tets_per_cell = 6);

// Moves the nodes that are not on the box's boundary by up to `amplitude` in each axis, reproducibly.
void jitter_interior(TetMesh& mesh, const Vec3& size, double amplitude, std::uint32_t seed);

// Whether a node lies on the boundary of the box [0, size].
bool on_box_boundary(const Vec3& node, const Vec3& size);

}  // namespace hapticd
