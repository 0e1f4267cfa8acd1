#include "server/mesh/foreign_format.h"

#include <algorithm>
#include <cctype>
#include <string_view>

namespace hapticd {
namespace {

constexpr std::size_t head_bytes = 4096;

std::string ending_of(const std::filesystem::path& file) {
  std::string ending = file.extension().string();
  std::ranges::transform(ending, ending.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending;
}

}  // namespace

ForeignFormat foreign_format(const std::string& bytes, const std::filesystem::path& file) {
  const std::string_view head = std::string_view(bytes).substr(0, head_bytes);
  const auto has = [&](std::string_view word) { return head.find(word) != std::string_view::npos; };
  const std::string ending = ending_of(file);
  if (head.starts_with("# vtk DataFile"))
    return has("POLYDATA") ? ForeignFormat::vtk_surface : ForeignFormat::none;
  if (const std::size_t at = head.find("$MeshFormat"); at != std::string_view::npos) {
    const std::string_view version =
        head.substr(std::min(head.find_first_not_of(" \r\n", at + 11), head.size()), 3);
    return version == "2.2" || version == "4.1" ? ForeignFormat::none : ForeignFormat::gmsh_other;
  }
  if (head.starts_with("$NOD")) return ForeignFormat::gmsh_1;
  if (has("<VTKFile")) return has("UnstructuredGrid") ? ForeignFormat::vtu : ForeignFormat::vtk_surface;
  if (has("<Xdmf")) return ForeignFormat::xdmf;
  if (has("<dolfin") || has("<?xml")) return ForeignFormat::xml;
  if (head.starts_with("ply")) return ForeignFormat::ply;
  if (head.starts_with("OFF")) return ForeignFormat::off;
  if (has("MeshVersionFormatted")) return ForeignFormat::medit;
  if (ending == ".inp") return ForeignFormat::abaqus;
  if (ending == ".obj") return ForeignFormat::obj;
  if (ending == ".stl" || head.starts_with("solid ")) return ForeignFormat::stl;
  return ForeignFormat::unknown;
}

std::string name_of(ForeignFormat format) {
  switch (format) {
    case ForeignFormat::none:
      return "a mesh that hapticd reads";
    case ForeignFormat::stl:
      return "an STL surface";
    case ForeignFormat::ply:
      return "a PLY surface";
    case ForeignFormat::obj:
      return "a Wavefront OBJ surface";
    case ForeignFormat::off:
      return "an OFF surface";
    case ForeignFormat::vtk_surface:
      return "a VTK surface (polygons)";
    case ForeignFormat::vtu:
      return "a VTK XML mesh (.vtu)";
    case ForeignFormat::gmsh_1:
      return "a Gmsh 1.0 mesh ($NOD)";
    case ForeignFormat::gmsh_other:
      return "a Gmsh mesh of another version than 2.2 and 4.1";
    case ForeignFormat::medit:
      return "a Medit mesh";
    case ForeignFormat::abaqus:
      return "an Abaqus mesh";
    case ForeignFormat::xdmf:
      return "an XDMF mesh";
    case ForeignFormat::xml:
      return "an XML mesh (DOLFIN)";
    case ForeignFormat::unknown:
      break;
  }
  return "neither a Gmsh mesh ($MeshFormat) nor a legacy VTK file (# vtk DataFile)";
}

bool is_surface(ForeignFormat format) {
  return format == ForeignFormat::stl || format == ForeignFormat::ply || format == ForeignFormat::obj ||
         format == ForeignFormat::off || format == ForeignFormat::vtk_surface;
}

std::string foreign_advice(ForeignFormat format) {
  if (format == ForeignFormat::unknown) return name_of(format) + ", nor any other format that is known here";
  return name_of(format) +
         (is_surface(format) ? ": the tissue inside is to be meshed"
                             : ": not read here, it is to be converted") +
         " (`haptic mesh FILE --scene OUT.yaml` does so)";
}

}  // namespace hapticd
