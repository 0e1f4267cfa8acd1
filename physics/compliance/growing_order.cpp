#include "physics/compliance/growing_order.h"

#include <algorithm>
#include <numeric>

namespace hapticd {

GrowingOrder::GrowingOrder(std::span<const int> fill_order)
    : rank_(fill_order.size()), origin_(fill_order.size()) {
  for (std::size_t k = 0; k < fill_order.size(); ++k) rank_[fill_order[k]] = static_cast<int>(k);
  std::iota(origin_.begin(), origin_.end(), 0);
}

void GrowingOrder::follow(const TissueModel& model, std::span<const SystemMatrix::Element> before,
                          std::span<const int> tets) {
  const int known = node_count();
  for (int n = known; n < model.nodes_in_use; ++n) {
    rank_.push_back(model.nodes_in_use);  // last, if no tetrahedron tells
    origin_.push_back(n);
  }
  for (const int t : tets) {
    const int ancestor = known_ancestor(model, before, t);
    if (ancestor < 0) continue;
    const Tet& corners = model.mesh.tets[t];
    for (const int lost : before[ancestor].node) {
      if (lost >= known || std::find(corners.begin(), corners.end(), lost) != corners.end()) continue;
      for (const int n : corners)
        if (n >= known && rank_[lost] < rank_[n]) {
          rank_[n] = rank_[lost];
          origin_[n] = lost;
        }
    }
  }
}

std::vector<int> GrowingOrder::order() const {
  std::vector<int> order(rank_.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return rank_[a] < rank_[b]; });
  return order;
}

}  // namespace hapticd
