// The surface of a body at one moment, and its file: legacy VTK polydata, ASCII, with the cell scalar `cut`
// (1: exposed by a removal or made by a cut, 0: the body's own surface). ParaView and plot_demo.py read it.
//
// Units: m. Nodes that no triangle uses are left out.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "physics/tissue/mesh.h"

namespace hapticd {

struct DisplaySurface {
  std::vector<Vec3> points;
  std::vector<Triangle> triangles;
  std::vector<bool> cut;  // per triangle
};

// alive: 1 bit per tetrahedron, least significant first; empty: all alive. opened: faces that cuts made
// (physics/tissue/surface.h).
// Throws std::invalid_argument when the mesh is no mesh (a face with three tetrahedra).
DisplaySurface display_surface(const TetMesh& mesh, std::span<const Vec3> nodes,
                               std::span<const std::uint8_t> alive,
                               std::span<const std::uint32_t> opened = {});

std::string to_vtk(const DisplaySurface& surface, const std::string& title);

}  // namespace hapticd
