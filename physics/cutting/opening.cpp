#include "physics/cutting/opening.h"

#include <algorithm>

#include "physics/tissue/surface.h"

namespace hapticd {

namespace {

bool has(const Tet& tet, int node) noexcept { return std::find(tet.begin(), tet.end(), node) != tet.end(); }

int double_node(TissueModel& model, TissueState& state, int node, TopologyChange& change) noexcept {
  const int twin = take_node(model);
  model.mesh.nodes[twin] = model.mesh.nodes[node];
  model.fixed[twin] = model.fixed[node];
  state.x[twin] = state.x[node];
  state.v[twin] = state.v[node];
  for (MeshGroup& group : model.mesh.groups)
    if (std::binary_search(group.nodes.begin(), group.nodes.end(), node)) group.nodes.push_back(twin);
  change.nodes.push_back(twin);
  change.node_of.push_back(node);
  return twin;
}

// Gives every labelled component but the first a double of the node.
void part_node(TissueModel& model, TissueState& state, CutWorkspace& work, int node, int components,
               TopologyChange& change) noexcept {
  const int first_twin = model.nodes_in_use;
  for (int c = 1; c < components; ++c) double_node(model, state, node, change);
  work.stars.clear(node);
  for (const int t : work.star) {
    Tet& tet = model.mesh.tets[t];
    const int corner = static_cast<int>(std::find(tet.begin(), tet.end(), node) - tet.begin());
    if (work.label[t] > 0) {
      tet[corner] = first_twin + work.label[t] - 1;
      change.add_tet(t);
    }
    work.stars.link(tet[corner], t, corner);
  }
}

// Whether the two sides of a face still have all three nodes in common.
bool joined(const TissueModel& model, int face) noexcept {
  const Tet& other = model.mesh.tets[model.across[face] / 4];
  const Triangle nodes = outward_face(model.mesh.tets[face / 4], face % 4);
  return std::all_of(nodes.begin(), nodes.end(), [&](int n) { return has(other, n); });
}

// The faces of the node's star that are to open, and can.
void part_faces(TissueModel& model, const TissueState& state, CutWorkspace& work, int node,
                TopologyChange& change) noexcept {
  work.stars.live(state, node, work.star);
  for (const int t : work.star)
    for (int id = 4 * t; id < 4 * t + 4; ++id) {
      if (!work.held_open[id] || !is_inner(model, state, id) || joined(model, id)) continue;
      const int other = model.across[id];
      work.held_open[id] = work.held_open[other] = 0;
      model.across[id] = model.across[other] = opened_face;
      change.opened.push_back({id, other});
    }
}

// Collapsed tetrahedra have copies of their nodes.
void repoint_collapsed(const TissueModel& model, TissueState& state) noexcept {
  for (Collapsed& c : state.collapsed) c.node = model.mesh.tets[c.tet];
}

// The nodes of work.nodes get a double for each further component of their stars; what they held open opens.
CutStatus part_nodes(TissueModel& model, TissueState& state, CutWorkspace& work,
                     TopologyChange& change) noexcept {
  int needed = 0;
  for (const int n : work.nodes) {
    needed += label_star(model, state, work, n) - 1;
    forget_labels(work);
  }
  if (model.nodes_in_use + needed > model.node_count()) return CutStatus::no_room;

  const int first_twin = model.nodes_in_use;
  for (const int n : work.nodes) {
    const int components = label_star(model, state, work, n);
    if (components > 1) part_node(model, state, work, n, components, change);
    forget_labels(work);
  }
  const auto follow = [&](int n) {
    part_faces(model, state, work, n, change);
    sum_star(model, state, work, n);
  };
  if (first_twin < model.nodes_in_use) {
    for (const int n : work.nodes) follow(n);
    for (int n = first_twin; n < model.nodes_in_use; ++n) follow(n);
    repoint_collapsed(model, state);
  }
  return CutStatus::done;
}

}  // namespace

CutStatus open_faces(TissueModel& model, TissueState& state, CutWorkspace& work, std::span<const int> faces,
                     TopologyChange& change) noexcept {
  work.faces.clear();  // those that were not to open yet
  work.nodes.clear();
  for (const int id : faces) {
    if (!is_inner(model, state, id)) continue;
    for (const int n : outward_face(model.mesh.tets[id / 4], id % 4)) work.nodes.push_back(n);
    if (work.held_open[id]) continue;
    work.held_open[id] = work.held_open[model.across[id]] = 1;
    work.faces.push_back(id);
  }
  std::sort(work.nodes.begin(), work.nodes.end());
  work.nodes.erase(std::unique(work.nodes.begin(), work.nodes.end()), work.nodes.end());
  if (work.nodes.empty()) return CutStatus::nothing;
  const CutStatus status = part_nodes(model, state, work, change);
  if (status == CutStatus::no_room)
    for (const int id : work.faces) work.held_open[id] = work.held_open[model.across[id]] = 0;
  return status;
}

CutStatus part_hinges(TissueModel& model, TissueState& state, CutWorkspace& work, std::span<const int> nodes,
                      TopologyChange& change) noexcept {
  work.nodes.clear();
  for (const int n : nodes)
    if (state.live_tets_of_node[n] > 1) {
      if (label_star(model, state, work, n) > 1) work.nodes.push_back(n);
      forget_labels(work);
    }
  if (work.nodes.empty()) return CutStatus::nothing;
  return part_nodes(model, state, work, change);
}

}  // namespace hapticd
