// An instrument's surface as triangles, of its shape as the daemon tells it (idl/scene.idl, SceneInstrument).
//
// Spheres, capsules and cylinders are surfaces of revolution about local z with 16 corners around; a convex
// part comes as triangles. Units: m, the instrument's frame. Errors: none; what is no known shape is left
// out.
#pragma once

#include <span>
#include <vector>

#include "physics/types.h"

namespace hapticd {

// Three corners each.
std::vector<Vec3> instrument_surface(std::span<const float> primitives);

}  // namespace hapticd
