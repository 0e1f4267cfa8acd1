#include "physics/cutting/cut_workspace.h"

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

int take_node(TissueModel& model) noexcept { return model.nodes_in_use++; }

}  // namespace hapticd
