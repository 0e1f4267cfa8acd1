// What a file of geometry is, where hapticd reads it not: by its first bytes, or its name's ending.
//
// Of STL, PLY, OBJ and OFF a surface is all there is; the others may have tetrahedra. Errors: none.
#pragma once

#include <filesystem>
#include <string>

namespace hapticd {

enum class ForeignFormat {
  none,
  stl,
  ply,
  obj,
  off,
  vtk_surface,
  vtu,
  gmsh_1,
  gmsh_other,
  medit,
  abaqus,
  xdmf,
  xml,
  unknown
};

// none: read_mesh (mesh_reader.h) knows it.
ForeignFormat foreign_format(const std::string& bytes, const std::filesystem::path& file);

// "an STL surface"
std::string name_of(ForeignFormat format);
bool is_surface(ForeignFormat format);

// "hapticd does not read …: `haptic mesh FILE --scene OUT.yaml` makes …"
std::string foreign_advice(ForeignFormat format);

}  // namespace hapticd
