// What differs from part to part of one body: the material and the tension of a region, springs to the world.
//
//   F_e = F U,   U = diag(stretch):   g → U g,   V → V / det U,   ρ → ρ det U
//
// A region's natural shape is the mesh's, each axis shortened by its stretch: where the mesh stands, the
// tissue is strained by U − I. A bar that is held at both ends, stretched by 1 + ε along its axis, pulls with
// E A ε. Mass stays what the mesh and the density say. Units: Pa, kg/m³, N/m, m. Errors:
// std::invalid_argument for a tetrahedron or a node that does not exist, and for a stretch that is not
// positive.
#pragma once

#include <span>
#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

struct TissueRegion {
  std::vector<int> tets;
  Material material;            // E, ν, density; the body's damping and law hold everywhere
  Vec3 stretch = Vec3::Ones();  // along the axes of the world
};

// Once for a tetrahedron, after make_tissue_model. A stretched tetrahedron must never be subdivided.
void set_region(TissueModel& model, const TissueRegion& region);

// One a node, those of the first mesh; empty: none. A node that a cut makes has none.
void set_springs(TissueModel& model, std::span<const NodeSpring> springs);

}  // namespace hapticd
