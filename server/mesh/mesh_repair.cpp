#include "server/mesh/mesh_repair.h"

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>

#include "physics/tissue/mesh_quality.h"
#include "physics/tissue/surface.h"

namespace hapticd {
namespace {

constexpr double same_place = 1e-9;  // of the mesh's diagonal

using Numbers = std::unordered_map<std::uint64_t, std::uint64_t>;

// Number → the lowest number at the same place; only of nodes that are not the lowest.
Numbers duplicates_of(const std::vector<RawNode>& nodes) {
  Eigen::AlignedBox3d box;
  std::vector<const RawNode*> sorted;
  for (const RawNode& n : nodes) {
    if (!n.x.allFinite()) continue;  // finish_mesh names it
    box.extend(n.x);
    sorted.push_back(&n);
  }
  const double near = box.isEmpty() ? 0 : same_place * box.diagonal().norm();
  std::sort(sorted.begin(), sorted.end(), [](const RawNode* a, const RawNode* b) {
    return a->x.x() != b->x.x() ? a->x.x() < b->x.x() : a->number < b->number;
  });
  Numbers lowest;
  const auto root = [&](std::uint64_t n) {
    for (auto it = lowest.find(n); it != lowest.end(); it = lowest.find(n)) n = it->second;
    return n;
  };
  for (std::size_t i = 0; i < sorted.size(); ++i)
    for (std::size_t j = i + 1; j < sorted.size() && sorted[j]->x.x() - sorted[i]->x.x() <= near; ++j) {
      const std::uint64_t a = root(sorted[i]->number), b = root(sorted[j]->number);
      if (a != b && (sorted[i]->x - sorted[j]->x).norm() <= near) lowest[std::max(a, b)] = std::min(a, b);
    }
  for (auto& [number, first] : lowest) first = root(first);
  return lowest;
}

bool names_a_node_twice(const RawTet& tet) {
  return std::set<std::uint64_t>(tet.node.begin(), tet.node.end()).size() < 4;
}

int pieces_in(const RawMesh& raw) {
  Numbers index;
  TetMesh mesh;
  for (const RawTet& tet : raw.tets) {
    Tet t;
    for (int a = 0; a < 4; ++a)
      t[a] = static_cast<int>(index.try_emplace(tet.node[a], index.size()).first->second);
    mesh.tets.push_back(t);
  }
  mesh.nodes.resize(index.size());
  const std::vector<int> piece = pieces_of(mesh);
  return static_cast<int>(std::set<int>(piece.begin(), piece.end()).size());
}

// Takes the marked tetrahedra out, of the groups too.
void take_out(RawMesh& raw, const std::vector<bool>& gone) {
  std::vector<std::size_t> place(raw.tets.size());
  std::size_t kept = 0;
  for (std::size_t e = 0; e < raw.tets.size(); ++e) {
    place[e] = kept;
    if (!gone[e]) raw.tets[kept++] = raw.tets[e];
  }
  raw.tets.resize(kept);
  for (RawGroup& group : raw.groups) {
    std::erase_if(group.tets, [&](std::size_t e) { return gone[e]; });
    for (std::size_t& e : group.tets) e = place[e];
  }
}

void merge_nodes(RawMesh& raw, const Numbers& lowest) {
  const auto rename = [&](std::uint64_t& n) {
    if (const auto it = lowest.find(n); it != lowest.end()) n = it->second;
  };
  std::erase_if(raw.nodes, [&](const RawNode& n) { return lowest.contains(n.number); });
  for (RawTet& tet : raw.tets)
    for (std::uint64_t& n : tet.node) rename(n);
  for (RawGroup& group : raw.groups)
    for (std::uint64_t& n : group.nodes) rename(n);
}

// Exchanges two corners of each inverted tetrahedron.
void turn_right_side_out(RawMesh& raw, MeshFaults& faults) {
  std::unordered_map<std::uint64_t, const RawNode*> node;
  for (const RawNode& n : raw.nodes) node.emplace(n.number, &n);
  for (RawTet& tet : raw.tets) {
    std::array<Vec3, 4> x;
    bool complete = true;
    for (int a = 0; a < 4; ++a) {
      const auto found = node.find(tet.node[a]);
      complete = complete && found != node.end();
      if (complete) x[a] = found->second->x;
    }
    if (!complete || tet_shape(x) != TetShape::inverted) continue;  // finish_mesh names what is incomplete
    std::swap(tet.node[2], tet.node[3]);
    if (faults.inverted++ == 0) faults.first_inverted_line = tet.place.line;
  }
}

int repeated_in(const RawMesh& raw) {
  std::set<std::array<std::uint64_t, 4>> seen;
  for (const RawTet& tet : raw.tets) {
    auto key = tet.node;
    std::sort(key.begin(), key.end());
    seen.insert(key);
  }
  // Gmsh writes an element once for each physical group it is in: that is no fault.
  std::size_t in_groups = 0;
  for (const RawGroup& group : raw.groups) in_groups += group.tets.size();
  const std::size_t more = raw.tets.size() - seen.size();
  return static_cast<int>(in_groups > seen.size() ? 0 : more);
}

}  // namespace

RepairedMesh repair_mesh(RawMesh raw, bool merge) {
  RepairedMesh out;
  std::map<std::uint64_t, const RawNode*> twice;
  for (const RawNode& n : raw.nodes)
    if (!twice.emplace(n.number, &n).second)
      throw mesh_error(raw.file, n.place, "nodes", "node " + std::to_string(n.number) + " appears twice");
  out.faults.pieces_before = pieces_in(raw);
  const Numbers lowest = duplicates_of(raw.nodes);
  out.faults.duplicate_nodes = static_cast<int>(lowest.size());
  if (merge) merge_nodes(raw, lowest);
  std::vector<bool> gone(raw.tets.size());
  for (std::size_t e = 0; e < raw.tets.size(); ++e) gone[e] = names_a_node_twice(raw.tets[e]);
  out.faults.collapsed = static_cast<int>(std::count(gone.begin(), gone.end(), true));
  if (merge) take_out(raw, gone);
  out.faults.repeated = repeated_in(raw);
  turn_right_side_out(raw, out.faults);
  out.mesh = finish_mesh(raw);
  out.faults.orphan_nodes = static_cast<int>(raw.nodes.size() - out.mesh.nodes.size());
  const std::vector<int> piece = pieces_of(out.mesh);
  out.faults.pieces = static_cast<int>(std::set<int>(piece.begin(), piece.end()).size());
  try {
    BoundarySurface(out.mesh);
  } catch (const std::invalid_argument& e) {
    throw InputError(raw.file, 0, raw.tet_section, std::string(e.what()) + " (mesh again)");
  }
  return out;
}

}  // namespace hapticd
