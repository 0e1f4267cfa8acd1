#include "physics/cutting/cut_workspace.h"

#include <algorithm>

namespace hapticd {

CutWorkspace::CutWorkspace(TissueModel& model)
    : stars(model), held_open(4 * model.mesh.tets.size(), 0), label(model.mesh.tets.size(), -1) {
  const std::size_t nodes_of_model = model.mesh.nodes.size();
  const std::size_t tets_of_model = model.mesh.tets.size();
  for (std::vector<int>* scratch : {&star, &other_star, &stack}) scratch->reserve(tets_of_model);
  nodes.reserve(12 * tets_of_model);
  faces.reserve(4 * tets_of_model);
  for (MeshGroup& group : model.mesh.groups) {
    group.nodes.reserve(group.nodes.size() + nodes_of_model - model.nodes_in_use);
    group.tets.reserve(group.tets.size() + tets_of_model - model.tets_in_use);
  }
}

void sum_star(const TissueModel& model, TissueState& state, CutWorkspace& work, int node) noexcept {
  work.stars.live(state, node, work.other_star);
  double mass = 0;
  for (const int t : work.other_star) mass += 0.25 * model.elastic[t].density * volume_left(model, state, t);
  state.mass[node] = mass;
  state.live_tets_of_node[node] = static_cast<int>(work.other_star.size());
}

bool is_inner(const TissueModel& model, const TissueState& state, int face) noexcept {
  const int other = model.across[face];
  return other >= 0 && state.alive[face / 4] && state.alive[other / 4];
}

int label_star(const TissueModel& model, const TissueState& state, CutWorkspace& work, int node) noexcept {
  work.stars.live(state, node, work.star);
  int components = 0;
  for (const int first : work.star) {
    if (work.label[first] >= 0) continue;
    work.label[first] = components;
    work.stack.assign(1, first);
    while (!work.stack.empty()) {
      const int t = work.stack.back();
      work.stack.pop_back();
      for (int f = 0; f < 4; ++f) {
        const int id = 4 * t + f;
        if (model.mesh.tets[t][f] == node || work.held_open[id] || !is_inner(model, state, id)) continue;
        const int neighbour = model.across[id] / 4;
        if (work.label[neighbour] >= 0) continue;
        work.label[neighbour] = components;
        work.stack.push_back(neighbour);
      }
    }
    ++components;
  }
  return components;
}

void forget_labels(CutWorkspace& work) noexcept {
  for (const int t : work.star) work.label[t] = -1;
}

int take_node(TissueModel& model) noexcept { return model.nodes_in_use++; }

}  // namespace hapticd
