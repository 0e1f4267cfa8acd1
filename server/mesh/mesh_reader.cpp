#include "server/mesh/mesh_reader.h"

#include <algorithm>
#include <map>

#include "server/files/paths.h"
#include "server/mesh/foreign_format.h"
#include "server/mesh/mesh_reader_raw.h"

namespace hapticd {
namespace {

constexpr double degenerate = 1e-12;

void check_shape(const RawMesh& raw, const RawTet& tet, const std::array<Vec3, 4>& corner) {
  const TetShape shape = tet_shape(corner);
  if (shape == TetShape::degenerate)
    throw mesh_error(raw.file, tet.place, raw.tet_section,
                     describe_tet(tet) + " is degenerate: it has no volume (mesh again, or take it out)");
  if (shape == TetShape::inverted)
    throw mesh_error(raw.file, tet.place, raw.tet_section,
                     describe_tet(tet) + " is inverted: its volume is negative (exchange two of its nodes, or "
                     "let `haptic mesh FILE --fix OUT` do it)");
}

void sort_unique(std::vector<int>& v) {
  std::sort(v.begin(), v.end());
  v.erase(std::unique(v.begin(), v.end()), v.end());
}

}  // namespace

std::string describe_tet(const RawTet& tet) {
  std::string text = "tetrahedron with nodes";
  for (std::uint64_t n : tet.node) text += " " + std::to_string(n);
  return text;
}

TetShape tet_shape(const std::array<Vec3, 4>& x) {
  double longest = 0;
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < a; ++b) longest = std::max(longest, (x[a] - x[b]).norm());
  const double volume = signed_volume(x[0], x[1], x[2], x[3]);
  if (!(std::abs(volume) >= degenerate * longest * longest * longest) || volume == 0)
    return TetShape::degenerate;
  return volume < 0 ? TetShape::inverted : TetShape::positive;
}

InputError mesh_error(const std::filesystem::path& file, const MeshPlace& place, const std::string& section,
                      const std::string& what) {
  return {file, place.line, section,
          place.line > 0 ? what : what + " (at byte " + std::to_string(place.byte) + ")"};
}

RawGroup& RawMesh::group(const std::string& name) {
  const auto [found, is_new] = group_index_.try_emplace(name, groups.size());
  if (is_new) groups.push_back({name, {}, {}});
  return groups[found->second];
}

TetMesh finish_mesh(const RawMesh& raw) {
  if (raw.tets.empty())
    throw InputError(raw.file, 0, raw.tet_section,
                     "no tetrahedra (a volume mesh is needed: `gmsh -3`, and a physical volume if there are "
                     "physical groups at all)");

  std::vector<const RawNode*> by_number;
  for (const RawNode& n : raw.nodes) by_number.push_back(&n);
  std::stable_sort(by_number.begin(), by_number.end(),
                   [](const RawNode* a, const RawNode* b) { return a->number < b->number; });
  for (std::size_t i = 0; i < by_number.size(); ++i) {
    const RawNode& n = *by_number[i];
    if (i > 0 && n.number == by_number[i - 1]->number)
      throw mesh_error(raw.file, n.place, "nodes", "node " + std::to_string(n.number) + " appears twice");
    if (!n.x.allFinite())
      throw mesh_error(raw.file, n.place, "nodes", "node " + std::to_string(n.number) + " is not finite");
  }
  const auto find = [&](std::uint64_t number) -> std::size_t {
    const auto it = std::lower_bound(by_number.begin(), by_number.end(), number,
                                     [](const RawNode* a, std::uint64_t n) { return a->number < n; });
    return it == by_number.end() || (*it)->number != number ? by_number.size()
                                                            : std::size_t(it - by_number.begin());
  };

  // Gmsh writes an element once per physical group it is in: keep the first.
  TetMesh mesh;
  std::map<Tet, int> seen;
  std::vector<int> new_tet(raw.tets.size());
  std::vector<int> used(by_number.size(), -1);
  std::vector<Tet> old_corners;
  for (std::size_t e = 0; e < raw.tets.size(); ++e) {
    const RawTet& tet = raw.tets[e];
    std::array<Vec3, 4> corner;
    Tet t;
    for (int a = 0; a < 4; ++a) {
      const std::size_t i = find(tet.node[a]);
      if (i == by_number.size())
        throw mesh_error(raw.file, tet.place, raw.tet_section,
                         describe_tet(tet) + ": there is no node " + std::to_string(tet.node[a]));
      t[a] = static_cast<int>(i);
      corner[a] = by_number[i]->x;
    }
    check_shape(raw, tet, corner);
    Tet key = t;
    std::sort(key.begin(), key.end());
    const auto [it, inserted] = seen.try_emplace(key, static_cast<int>(old_corners.size()));
    new_tet[e] = it->second;
    if (!inserted) continue;
    old_corners.push_back(t);
    for (int n : t) used[n] = 0;
  }

  for (std::size_t i = 0; i < used.size(); ++i) {
    if (used[i] < 0) continue;
    used[i] = static_cast<int>(mesh.nodes.size());
    mesh.nodes.push_back(by_number[i]->x);
  }
  for (Tet t : old_corners) {
    for (int& n : t) n = used[n];
    mesh.tets.push_back(t);
  }
  for (const RawGroup& g : raw.groups) {
    MeshGroup group{g.name, {}, {}};
    for (std::uint64_t number : g.nodes) {
      const std::size_t i = find(number);
      if (i < used.size() && used[i] >= 0) group.nodes.push_back(used[i]);
    }
    for (std::size_t e : g.tets) group.tets.push_back(new_tet[e]);
    sort_unique(group.nodes);
    sort_unique(group.tets);
    mesh.groups.push_back(std::move(group));
  }
  return mesh;
}

RawMesh read_raw_mesh(const std::string& bytes, const std::filesystem::path& file) {
  if (bytes.starts_with("# vtk DataFile")) return read_vtk(bytes, file);
  if (bytes.find("$MeshFormat") < 4096) return read_gmsh(bytes, file);
  throw InputError(file, 1, "", foreign_advice(foreign_format(bytes, file)));
}

TetMesh read_mesh(const std::string& bytes, const std::filesystem::path& file) {
  return finish_mesh(read_raw_mesh(bytes, file));
}

TetMesh read_mesh_file(const std::filesystem::path& file) { return read_mesh(read_bytes(file), file); }

}  // namespace hapticd
