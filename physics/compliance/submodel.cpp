#include "physics/compliance/submodel.h"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "physics/tissue/surface.h"

namespace hapticd {

Submodel::Submodel(const TissueModel& whole, std::vector<int> nodes, std::vector<int> tets,
                   const CondensedTissue* condensed)
    : node(std::move(nodes)),
      tet(std::move(tets)),
      of_node(whole.mesh.nodes.size(), -1),
      of_tet(whole.mesh.tets.size(), -1) {
  for (std::size_t k = 0; k < node.size(); ++k) of_node[node[k]] = static_cast<int>(k);
  for (std::size_t k = 0; k < tet.size(); ++k) of_tet[tet[k]] = static_cast<int>(k);

  model.material = whole.material;
  model.gravity = whole.gravity;
  model.corotational = whole.corotational;
  model.dynamic = whole.dynamic;
  for (const int n : node) {
    model.mesh.nodes.push_back(whole.mesh.nodes[n]);
    model.fixed.push_back(whole.fixed[n]);
    if (!whole.springs.empty()) model.springs.push_back(whole.springs[n]);
  }
  for (const int t : tet) {
    model.mesh.tets.push_back(own(whole.mesh.tets[t]));
    model.elastic.push_back(whole.elastic[t]);
    model.gradients.push_back(whole.gradients[t]);
    model.volume.push_back(whole.volume[t]);
  }
  model.across = faces_across(model.mesh.tets);
  model.parent.resize(tet.size());
  std::iota(model.parent.begin(), model.parent.end(), 0);
  model.nodes_in_use = static_cast<int>(node.size());
  model.tets_in_use = static_cast<int>(tet.size());

  if (condensed) {
    auto of = std::make_shared<CondensedTissue>(*condensed);
    of->place.assign(node.size(), -1);
    of->tet.assign(tet.size(), 0);
    of->near_node.resize(node.size());
    of->near_tet.resize(tet.size());
    std::iota(of->near_node.begin(), of->near_node.end(), 0);
    std::iota(of->near_tet.begin(), of->near_tet.end(), 0);
    for (std::size_t i = 0; i < of->node.size(); ++i) {
      of->node[i] = of_node[condensed->node[i]];
      of->place[of->node[i]] = static_cast<int>(i);
      if (!model.springs.empty()) model.springs[of->node[i]] = {};
    }
    model.condensed = std::move(of);
  }
  state = rest_state(model);
}

Tet Submodel::own(const Tet& corners) const {
  Tet mine;
  for (int a = 0; a < 4; ++a) mine[a] = of_node[corners[a]];
  return mine;
}

const TissueState& Submodel::follow(const TissueState& whole) {
  for (std::size_t k = 0; k < tet.size(); ++k) {
    state.alive[k] = whole.alive[tet[k]];
    state.left[k] = whole.left[tet[k]];
    state.rotation[k] = whole.rotation[tet[k]];
  }
  for (std::size_t i = 0; i < node.size(); ++i) {
    state.mass[i] = whole.mass[node[i]];
    state.live_tets_of_node[i] = whole.live_tets_of_node[node[i]];
  }
  state.collapsed = whole.collapsed;
  for (Collapsed& c : state.collapsed) {
    c.tet = of_tet[c.tet];
    c.node = own(c.node);
  }
  // Of its own: what went before it was made is not in it.
  state.removed = static_cast<int>(std::count(state.alive.begin(), state.alive.end(), 0));
  state.thinnings = whole.thinnings;
  return state;
}

const std::vector<int>& Submodel::own(std::span<const int> whole, const std::vector<int>& number) {
  list_.clear();
  for (const int k : whole) {
    if (k < 0 || k >= static_cast<int>(number.size()))
      throw std::invalid_argument("the body has no node or tetrahedron " + std::to_string(k));
    if (number[k] >= 0) list_.push_back(number[k]);
  }
  return list_;
}

VecX Submodel::gather(const Eigen::Ref<const VecX>& whole) const {
  VecX mine(3 * static_cast<Eigen::Index>(node.size()));
  for (std::size_t i = 0; i < node.size(); ++i)
    mine.segment<3>(3 * static_cast<Eigen::Index>(i)) =
        whole.segment<3>(3 * static_cast<Eigen::Index>(node[i]));
  return mine;
}

void Submodel::scatter(const VecX& mine, Eigen::Ref<VecX> whole) const {
  whole.setZero();
  for (std::size_t i = 0; i < node.size(); ++i)
    whole.segment<3>(3 * static_cast<Eigen::Index>(node[i])) =
        mine.segment<3>(3 * static_cast<Eigen::Index>(i));
}

}  // namespace hapticd
