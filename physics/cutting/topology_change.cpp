#include "physics/cutting/topology_change.h"

namespace hapticd {

TopologyChange::TopologyChange(const TissueModel& model) : listed_(model.mesh.tets.size(), 0) {
  tets.reserve(model.mesh.tets.size());
  nodes.reserve(model.mesh.nodes.size());
  node_of.reserve(model.mesh.nodes.size());
  opened.reserve(2 * model.mesh.tets.size());
}

void TopologyChange::clear() noexcept {
  for (const int t : tets) listed_[t] = 0;
  tets.clear();
  nodes.clear();
  node_of.clear();
  opened.clear();
}

void TopologyChange::add_tet(int tet) noexcept {
  if (listed_[tet]) return;
  listed_[tet] = 1;
  tets.push_back(tet);
}

}  // namespace hapticd
