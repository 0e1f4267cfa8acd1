#include "physics/cutting/mesh_check.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <utility>

#include "physics/tissue/mesh_quality.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {

namespace {

constexpr double rounding = 1e-9;  // relative

std::string of_tet(const std::string& what, int t) { return what + " of tetrahedron " + std::to_string(t); }
std::string of_node(const std::string& what, int n) { return what + " of node " + std::to_string(n); }

TetMesh live_mesh(const TissueModel& model, const TissueState& state) {
  TetMesh live = model.mesh;
  for (int t = 0; t < model.tet_count(); ++t)
    if (!state.alive[t]) live.tets[t] = no_tet;
  return live;
}

std::string check_elements(const TissueModel& model, const TissueState& state) {
  for (int t = 0; t < model.tet_count(); ++t) {
    const Tet& tet = model.mesh.tets[t];
    if (t >= model.tets_in_use) {
      if (state.alive[t] || tet != no_tet) return of_tet("spare place in use", t);
      continue;
    }
    if (model.parent[t] < 0 || model.parent[t] > t) return of_tet("parent", t);
    for (const int n : tet)
      if (n < 0 || n >= model.nodes_in_use) return of_tet("corner", t);
    if (!state.alive[t]) continue;
    const Corners x = corners_of(tet, model.mesh.nodes);
    const RestShape shape = rest_shape(x.col(0), x.col(1), x.col(2), x.col(3));
    if (!(shape.volume > 0)) return of_tet("volume at rest", t);
    if (!(std::abs(shape.volume - model.volume[t]) <= rounding * shape.volume))
      return of_tet("kept volume", t);
    if (!((shape.gradients - model.gradients[t]).norm() <= rounding * shape.gradients.norm()))
      return of_tet("kept gradients", t);
  }
  return "";
}

std::string check_across(const TissueModel& model, const TissueState& state, const TetMesh& live) {
  const std::vector<int> expected = faces_across(live.tets);
  for (int id = 0; id < static_cast<int>(expected.size()); ++id) {
    if (!state.alive[id / 4]) continue;
    const int other = model.across[id];
    const bool joined = other >= 0 && state.alive[other / 4];
    if ((joined ? other : -1) != std::max(expected[id], -1)) return of_tet("across", id / 4);
    if (other >= 0 && model.across[other] != id) return of_tet("across, not symmetric,", id / 4);
  }
  return "";
}

std::string check_nodes(const TissueModel& model, const TissueState& state, CutWorkspace& work) {
  std::vector<std::vector<int>> stars(model.mesh.nodes.size());
  std::vector<char> named(model.mesh.nodes.size(), 0);
  for (int t = 0; t < model.tets_in_use; ++t)
    for (const int n : model.mesh.tets[t]) {
      named[n] = 1;
      if (state.alive[t]) stars[n].push_back(t);
    }
  std::vector<int> star;
  for (int n = 0; n < model.node_count(); ++n) {
    if (!named[n] && n < model.nodes_in_use) return of_node("no tetrahedron", n);
    double mass = 0;
    for (const int t : stars[n]) mass += 0.25 * model.elastic[t].density * volume_left(model, state, t);
    if (!(std::abs(mass - state.mass[n]) <= rounding * mass)) return of_node("mass", n);
    if (state.live_tets_of_node[n] != static_cast<int>(stars[n].size())) return of_node("count", n);
    work.stars.live(state, n, star);
    if (star != stars[n]) return of_node("star", n);
  }
  for (const MeshGroup& group : model.mesh.groups) {
    const auto sorted_unique = [](const std::vector<int>& v) {
      return std::adjacent_find(v.begin(), v.end(), std::greater_equal<>()) == v.end();
    };
    if (!sorted_unique(group.nodes) || !sorted_unique(group.tets)) return "order of group " + group.name;
  }
  return "";
}

// Each directed edge of the boundary is met as often as its reverse.
std::string check_closed(const std::vector<SurfaceFace>& faces) {
  std::map<std::pair<int, int>, int> excess;
  for (const SurfaceFace& face : faces)
    for (int c = 0; c < 3; ++c) {
      const int a = face.nodes[c];
      const int b = face.nodes[(c + 1) % 3];
      excess[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
    }
  for (const auto& [edge, sum] : excess)
    if (sum != 0) return of_node("open boundary edge", edge.first);
  return "";
}

std::string check_surface(const std::vector<SurfaceFace>& anew, const std::vector<SurfaceFace>& kept) {
  std::map<int, Triangle> expected;
  for (const SurfaceFace& face : anew) expected[face.id] = face.nodes;
  if (expected.size() != kept.size())
    return "surface has " + std::to_string(kept.size()) + " faces, not " + std::to_string(expected.size());
  for (const SurfaceFace& face : kept) {
    const auto found = expected.find(face.id);
    if (found == expected.end() || found->second != face.nodes) return of_tet("surface", face.id / 4);
  }
  return "";
}

}  // namespace

std::string check_mesh(const TissueModel& model, const TissueState& state, CutWorkspace& work,
                       const BoundarySurface* surface) {
  try {
    std::string wrong = check_elements(model, state);
    if (!wrong.empty()) return wrong;
    const TetMesh live = live_mesh(model, state);
    if (wrong = check_across(model, state, live); !wrong.empty()) return wrong;
    if (wrong = check_nodes(model, state, work); !wrong.empty()) return wrong;
    const BoundarySurface anew(live);
    if (wrong = check_closed(anew.faces()); !wrong.empty()) return wrong;
    return surface ? check_surface(anew.faces(), surface->faces()) : "";
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

double least_quality(const TissueModel& model, const TissueState& state) {
  double least = 1;
  const std::vector<Vec3>& x = model.mesh.nodes;
  for (int t = 0; t < model.tets_in_use; ++t) {
    if (!state.alive[t]) continue;
    const Tet& tet = model.mesh.tets[t];
    least = std::min(least, dihedral_quality(x[tet[0]], x[tet[1]], x[tet[2]], x[tet[3]]));
  }
  return least;
}

}  // namespace hapticd
