// A mesh or a surface of a format that hapticd does not read, made a tetrahedral mesh by programs that do.
//
//   STL                                  gmsh: surface classified, meshed anew with the wanted edge, filled;
//   or,
//                                        where gmsh is not installed or fails, tetgen: filled as it stands
//   OBJ, PLY, OFF, VTK polygons          meshio → STL, then as above
//   VTU, XDMF, DOLFIN XML, Medit, Abaqus meshio → legacy VTK
//   Gmsh 1.0 and others of Gmsh          gmsh → 2.2
//
// The programs are called where they are installed and named, with the command that installs them, where they
// are not. Units: the file's. Errors: InputError with the format that was seen, the command that failed and
// what it said.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "server/mesh/mesh_reader_raw.h"

namespace hapticd {

struct ForeignOptions {
  double edge = 0;  // of the tetrahedra [the file's unit]; 0: a 20th of the bounding box's diagonal
  std::filesystem::path folder;  // for what comes between; exists
};

struct ForeignMesh {
  RawMesh mesh;
  std::vector<std::string> commands;  // that made it; none: hapticd reads the file
};

// Reads any file: as it stands where hapticd can.
ForeignMesh read_any_mesh(const std::filesystem::path& file, const ForeignOptions& options);

}  // namespace hapticd
