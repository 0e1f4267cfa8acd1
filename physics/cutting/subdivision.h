// Subdivision: an edge (a, b) of live tetrahedra is split at m = (1 − s) a + s b.
//
//   (a, b, c, d) → (a, m, c, d) + (m, b, c, d),   volumes s V and (1 − s) V,   F of both as before
//
// Every live tetrahedron of the edge becomes two, so the mesh stays conforming. The half at a keeps its id;
// the half at b takes the next spare one, with `parent` the first. Rotations are copied. m gets rest place,
// x and v by interpolation; it is fixed, and in a group, if both a and b are, and in a group of tetrahedra
// also if one of those split is. As F is kept, so are elastic energy and forces, up to where they act. Cost:
// the stars of the tetrahedra's nodes. Guarantee: no allocation. Errors: CutStatus; unless `done` nothing has
// changed.
#pragma once

#include "physics/cutting/cut_workspace.h"
#include "physics/cutting/topology_change.h"

namespace hapticd {

struct EdgePoint {
  int a, b;
  double s;  // in (0, 1), from a to b
};

// `bound`: no half may have a lower dihedral quality (mesh_quality.h) than that, unless the whole has.
[[nodiscard]] CutStatus split_edge(TissueModel& model, TissueState& state, CutWorkspace& work,
                                   const EdgePoint& at, double bound, TopologyChange& change) noexcept;

}  // namespace hapticd
