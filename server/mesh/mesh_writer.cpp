#include "server/mesh/mesh_writer.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <map>
#include <set>
#include <stdexcept>

#include "physics/tissue/surface.h"

namespace hapticd {
namespace {

std::string text_of(const Vec3& x) {
  char line[96];
  std::snprintf(line, sizeof line, "%.17g %.17g %.17g", x.x(), x.y(), x.z());
  return line;
}

// Elements of a group in MSH: its tetrahedra, triangles and points that cover its nodes.
struct GroupElements {
  std::vector<Triangle> triangles;
  std::vector<int> points;
};

GroupElements elements_of(const TetMesh& mesh, const MeshGroup& group, const BoundarySurface& surface) {
  std::set<int> left(group.nodes.begin(), group.nodes.end());
  for (const int t : group.tets)
    for (const int n : mesh.tets[t]) left.erase(n);
  const std::set<int> in_surface_part = left;
  GroupElements out;
  for (const SurfaceFace& face : surface.faces()) {
    const Triangle& t = face.nodes;
    if (!std::all_of(t.begin(), t.end(), [&](int n) { return in_surface_part.contains(n); })) continue;
    out.triangles.push_back(t);
    for (const int n : t) left.erase(n);
  }
  out.points.assign(left.begin(), left.end());
  return out;
}

}  // namespace

std::string to_msh(const TetMesh& mesh) {
  const BoundarySurface surface(mesh);
  std::string names, elements;
  int name_count = 0, element_count = 0;
  const auto name = [&](int dimension, std::size_t number, const std::string& text) {
    names += std::to_string(dimension) + ' ' + std::to_string(number) + " \"" + text + "\"\n";
    ++name_count;
  };
  const auto element = [&](int type, std::size_t group, auto begin, auto end) {
    elements +=
        std::to_string(++element_count) + ' ' + std::to_string(type) + " 2 " + std::to_string(group) + " 1";
    for (; begin != end; ++begin) elements += ' ' + std::to_string(*begin + 1);
    elements += '\n';
  };

  // Every tetrahedron once in the mesh's order, in its first group; then once more for each further group.
  std::vector<std::size_t> first_group(mesh.tets.size(), 0);
  for (std::size_t g = mesh.groups.size(); g-- > 0;)
    for (const int t : mesh.groups[g].tets) first_group[t] = g + 1;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    element(4, first_group[t], mesh.tets[t].begin(), mesh.tets[t].end());
  for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
    const MeshGroup& group = mesh.groups[g];
    if (!group.tets.empty()) name(3, g + 1, group.name);
    for (const int t : group.tets)
      if (first_group[t] != g + 1) element(4, g + 1, mesh.tets[t].begin(), mesh.tets[t].end());
    const GroupElements others = elements_of(mesh, group, surface);
    if (!others.triangles.empty()) name(2, g + 1, group.name);
    for (const Triangle& t : others.triangles) element(2, g + 1, t.begin(), t.end());
    if (!others.points.empty() || group.nodes.empty()) name(0, g + 1, group.name);
    for (const int n : others.points) element(15, g + 1, &n, &n + 1);
  }

  std::string out = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n";
  if (name_count > 0)
    out += "$PhysicalNames\n" + std::to_string(name_count) + '\n' + names + "$EndPhysicalNames\n";
  out += "$Nodes\n" + std::to_string(mesh.nodes.size()) + '\n';
  for (std::size_t n = 0; n < mesh.nodes.size(); ++n)
    out += std::to_string(n + 1) + ' ' + text_of(mesh.nodes[n]) + '\n';
  out += "$EndNodes\n$Elements\n" + std::to_string(element_count) + '\n' + elements + "$EndElements\n";
  return out;
}

std::string to_vtk(const TetMesh& mesh) {
  std::string out = "# vtk DataFile Version 3.0\ntetrahedra\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS " +
                    std::to_string(mesh.nodes.size()) + " double\n";
  for (const Vec3& x : mesh.nodes) out += text_of(x) + '\n';
  const std::string count = std::to_string(mesh.tets.size());
  out += "CELLS " + count + ' ' + std::to_string(5 * mesh.tets.size()) + '\n';
  for (const Tet& t : mesh.tets) {
    out += '4';
    for (const int n : t) out += ' ' + std::to_string(n);
    out += '\n';
  }
  out += "CELL_TYPES " + count + '\n';
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) out += "10\n";

  // Groups of one stem share an array while no node is in two of them.
  std::vector<std::pair<std::string, std::vector<int>>> arrays;
  for (const MeshGroup& group : mesh.groups) {
    std::string stem = group.name;
    std::replace(stem.begin(), stem.end(), ' ', '_');
    int value = 1;
    if (const std::size_t at = stem.rfind('_');
        at != std::string::npos && at > 0 && at + 1 < stem.size() && stem.size() - at < 9 &&
        stem[at + 1] != '0' && stem.find_first_not_of("0123456789", at + 1) == std::string::npos) {
      value = std::stoi(stem.substr(at + 1));
      stem.resize(at);
    }
    auto array = std::find_if(arrays.begin(), arrays.end(), [&](const auto& a) {
      return a.first == stem &&
             std::all_of(group.nodes.begin(), group.nodes.end(), [&](int n) { return a.second[n] == 0; });
    });
    if (array == arrays.end())
      array = arrays.insert(arrays.end(), {stem, std::vector<int>(mesh.nodes.size(), 0)});
    for (const int n : group.nodes) array->second[n] = value;
  }
  if (!arrays.empty()) out += "POINT_DATA " + std::to_string(mesh.nodes.size()) + '\n';
  for (const auto& [stem, values] : arrays) {
    out += "SCALARS " + stem + " int 1\nLOOKUP_TABLE default\n";
    for (const int v : values) out += std::to_string(v) + '\n';
  }
  return out;
}

void write_mesh_file(const TetMesh& mesh, const std::filesystem::path& file) {
  const std::string ending = file.extension().string();
  if (ending != ".msh" && ending != ".vtk")
    throw std::invalid_argument(file.string() + ": a mesh is written as .msh (Gmsh 2.2) or .vtk (legacy)");
  std::ofstream out(file, std::ios::binary);
  out << (ending == ".msh" ? to_msh(mesh) : to_vtk(mesh));
  out.close();
  if (!out) throw std::runtime_error("cannot write " + file.string());
}

}  // namespace hapticd
