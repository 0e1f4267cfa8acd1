// Reads a tetrahedral mesh with its physical groups: Gmsh MSH 2.2 and 4.1 (ASCII and binary), legacy VTK
// (ASCII unstructured grid).
//
// Units: the file's; callers scale (scene_reader.h: `mesh_unit`). Result: nodes in the order of their
// numbers in the file, without those that no tetrahedron uses; tetrahedra in file order, each once; groups
// in order of appearance. Groups of MSH files are the physical groups of every dimension, named as in
// $PhysicalNames, else by their number. In VTK files every integer array on points or cells makes groups
// NAME_VALUE for its values above zero.
// Errors: InputError with the line (ASCII) or the byte (binary) for a tetrahedron that is inverted or
// degenerate (|V| < 1e-12 L³, L its longest edge), a node that does not exist, a missing section, cells
// other than linear tetrahedra, a file that ends early. Sizes in the file are never believed: memory is
// bounded by the length of the bytes, and any bytes at all either give a mesh or an InputError.
// Sources: Gmsh reference manual, "MSH file format"; "VTK file formats", simple legacy format.
#pragma once

#include <filesystem>
#include <string>

#include "physics/tissue/mesh.h"

namespace hapticd {

TetMesh read_mesh(const std::string& bytes, const std::filesystem::path& file);

TetMesh read_mesh_file(const std::filesystem::path& file);

}  // namespace hapticd
