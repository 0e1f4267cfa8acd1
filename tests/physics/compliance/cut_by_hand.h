// Cuts of a mesh, made by hand: a node opens along a plane, an edge is split. For tests; no surface follows.
#pragma once

#include <algorithm>
#include <random>
#include <vector>

#include "physics/compliance/compliance.h"
#include "physics/tissue/tetrahedron.h"
#include "tests/physics/compliance/oracle.h"

namespace hapticd::by_hand {

inline TissueModel box_with_room(int cells, MeshRoom room, bool held = true) {
  TetMesh mesh = box_mesh(oracle::size, cells, cells, cells);
  jitter_interior(mesh, oracle::size, 0.2 * oracle::size.z() / cells, 11);
  const std::vector<int> bottom = held ? mesh.group("bottom")->nodes : std::vector<int>();
  return make_tissue_model(std::move(mesh), {3000, 0.45, 1000, 2.0, 3e-3}, bottom, Vec3::Zero(), room);
}

inline void recount(const TissueModel& model, TissueState& state) {
  std::fill(state.mass.begin(), state.mass.end(), 0.0);
  std::fill(state.live_tets_of_node.begin(), state.live_tets_of_node.end(), 0);
  for (int t = 0; t < model.tets_in_use; ++t)
    for (const int n : model.mesh.tets[t]) {
      if (!state.alive[t]) continue;
      state.mass[n] += 0.25 * model.elastic[t].density * model.volume[t];
      ++state.live_tets_of_node[n];
    }
}

// Halfway between two nodes, which may be the same.
inline int new_node(TissueModel& model, TissueState& state, int a, int b) {
  const int n = model.nodes_in_use++;
  model.mesh.nodes[n] = 0.5 * (model.mesh.nodes[a] + model.mesh.nodes[b]);
  state.x[n] = 0.5 * (state.x[a] + state.x[b]);
  model.fixed[n] = model.fixed[a] && model.fixed[b];
  return n;
}

inline void replace(TissueModel& model, int tet, int old, int by) {
  Tet& corners = model.mesh.tets[tet];
  *std::find(corners.begin(), corners.end(), old) = by;
  const auto& x = model.mesh.nodes;
  const RestShape shape = rest_shape(x[corners[0]], x[corners[1]], x[corners[2]], x[corners[3]]);
  model.gradients[tet] = shape.gradients;
  model.volume[tet] = shape.volume;
}

inline std::vector<int> around(const TissueModel& model, const TissueState& state, int a, int b) {
  std::vector<int> tets;
  for (int t = 0; t < model.tets_in_use; ++t) {
    const Tet& c = model.mesh.tets[t];
    if (state.alive[t] && std::count(c.begin(), c.end(), a) && std::count(c.begin(), c.end(), b))
      tets.push_back(t);
  }
  return tets;
}

// The tetrahedra above the plane through the node get a duplicate of it. Returns them; none if all are on one
// side.
inline std::vector<int> open_node(TissueModel& model, TissueState& state, int node, const Vec3& normal) {
  std::vector<int> above;
  const std::vector<int> all = around(model, state, node, node);
  for (const int t : all) {
    Vec3 centre = Vec3::Zero();
    for (const int n : model.mesh.tets[t]) centre += 0.25 * model.mesh.nodes[n];
    if ((centre - model.mesh.nodes[node]).dot(normal) > 0) above.push_back(t);
  }
  if (above.empty() || above.size() == all.size() || model.nodes_in_use == model.node_count()) return {};
  const int twin = new_node(model, state, node, node);
  for (const int t : above) replace(model, t, node, twin);
  recount(model, state);
  return above;
}

// Each tetrahedron at the edge becomes two. Returns both halves of all.
inline std::vector<int> split_edge(TissueModel& model, TissueState& state, int a, int b) {
  std::vector<int> tets = around(model, state, a, b);
  const int count = static_cast<int>(tets.size());
  if (model.nodes_in_use == model.node_count() || model.tets_in_use + count > model.tet_count()) return {};
  const int middle = new_node(model, state, a, b);
  for (int k = 0; k < count; ++k) {
    const int child = model.tets_in_use++;
    model.mesh.tets[child] = model.mesh.tets[tets[k]];
    model.parent[child] = tets[k];
    state.rotation[child] = state.rotation[tets[k]];
    state.alive[child] = 1;
    replace(model, tets[k], b, middle);
    replace(model, child, a, middle);
    tets.push_back(child);
  }
  recount(model, state);
  return tets;
}

// An opening or a split at a node, by chance, told to the compliance. Returns what changed.
inline std::vector<int> cut_at(TissueModel& model, TissueState& state, Compliance& compliance, int node,
                               std::mt19937& random) {
  const std::vector<int> star = around(model, state, node, node);
  if (star.empty()) return {};
  std::vector<int> tets;
  if (random() % 2 == 0) {
    tets = open_node(model, state, node, random_vector(random, 1.0));
  } else {
    const Tet& corners = model.mesh.tets[star[random() % star.size()]];
    const int other = corners[random() % 4];
    if (other != node) tets = split_edge(model, state, node, other);
  }
  if (!tets.empty()) compliance.reshape(state, tets);
  return tets;
}

}  // namespace hapticd::by_hand
