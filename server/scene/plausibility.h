// What of a scene is allowed and yet hardly meant: said beside a plan and at the start, never refused.
//
//   a modulus that is no soft tissue's          50 Pa to 10 MPa
//   a size that is no organ's                   1 mm to 1 m: a mesh in another unit
//   a tip finer than the mesh                   radius below half the surface's mean edge
//   a tip larger than the body                  radius above half the bounding box's diagonal
//   more within the tip's reach than a problem holds: nodes and samples (condensed_problem.h)
//   a coupling softer than three times the tissue's contact, 2 E/(1 − ν²) √(r · r/2) half a radius deep
//
// Units: SI. Errors: none.
#pragma once

#include <string>
#include <vector>

#include "server/scene/scene.h"

namespace hapticd {

// A sentence each, beginning with the body's name.
std::vector<std::string> doubts(const Scene& scene);

// "; is the mesh in mm (mesh_unit: mm)?" where what is so large from corner to corner [m] would be an organ
// in another unit; else empty.
std::string unit_question(double diagonal);

// How many nodes are within an instrument's reach, 1.6 alarm distances from the tip, at so many places of the
// surface; sorted.
std::vector<int> nodes_in_reach(const TetMesh& mesh, double tip_radius, double alarm_distance);

}  // namespace hapticd
