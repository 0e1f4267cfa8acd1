// Writes a tetrahedral mesh that mesh_reader.h reads back the same: Gmsh MSH 2.2 ASCII, or legacy VTK
// (ASCII).
//
// Nodes, tetrahedra and their order come back bit for bit; groups with the same nodes. Where a group has
// tetrahedra it is a physical volume; its other nodes are boundary triangles that lie in the group whole, and
// points. In VTK a group is an integer array on the points: NAME_VALUE is `VALUE` in array NAME, any other
// name comes back as NAME_1, its blanks as underscores. Units: the mesh's. Throws std::runtime_error naming
// the file.
#pragma once

#include <filesystem>
#include <string>

#include "physics/tissue/mesh.h"

namespace hapticd {

std::string to_msh(const TetMesh& mesh);
std::string to_vtk(const TetMesh& mesh);

// By the file's ending: .msh or .vtk; std::invalid_argument for any other.
void write_mesh_file(const TetMesh& mesh, const std::filesystem::path& file);

}  // namespace hapticd
