#include "tools/record/surface_file.h"

#include <cstdio>

#include "physics/tissue/surface.h"

namespace hapticd {

DisplaySurface display_surface(const TetMesh& mesh, std::span<const Vec3> nodes,
                               std::span<const std::uint8_t> alive, std::span<const std::uint32_t> opened) {
  BoundarySurface boundary(mesh, opened);
  std::vector<int> removed;
  for (std::size_t t = 0; t < mesh.tets.size() && t / 8 < alive.size(); ++t)
    if (!(alive[t / 8] >> (t % 8) & 1)) removed.push_back(static_cast<int>(t));
  boundary.remove(removed);

  DisplaySurface surface;
  std::vector<int> point_of(nodes.size(), -1);
  for (const SurfaceFace& face : boundary.faces()) {
    Triangle triangle;
    for (std::size_t i = 0; i < 3; ++i) {
      int& point = point_of.at(static_cast<std::size_t>(face.nodes[i]));
      if (point < 0) {
        point = static_cast<int>(surface.points.size());
        surface.points.push_back(nodes[static_cast<std::size_t>(face.nodes[i])]);
      }
      triangle[i] = point;
    }
    surface.triangles.push_back(triangle);
    surface.cut.push_back(face.cut);
  }
  return surface;
}

std::string to_vtk(const DisplaySurface& surface, const std::string& title) {
  const std::string triangles = std::to_string(surface.triangles.size());
  std::string text = "# vtk DataFile Version 3.0\n" + title.substr(0, title.find('\n')) +
                     "\nASCII\nDATASET POLYDATA\nPOINTS " + std::to_string(surface.points.size()) +
                     " double\n";
  char line[96];
  for (const Vec3& p : surface.points) {
    std::snprintf(line, sizeof line, "%.9g %.9g %.9g\n", p.x(), p.y(), p.z());
    text += line;
  }
  text += "POLYGONS " + triangles + " " + std::to_string(4 * surface.triangles.size()) + "\n";
  for (const Triangle& t : surface.triangles) {
    std::snprintf(line, sizeof line, "3 %d %d %d\n", t[0], t[1], t[2]);
    text += line;
  }
  text += "CELL_DATA " + triangles + "\nSCALARS cut int 1\nLOOKUP_TABLE default\n";
  for (const bool cut : surface.cut) text += cut ? "1\n" : "0\n";
  return text;
}

}  // namespace hapticd
