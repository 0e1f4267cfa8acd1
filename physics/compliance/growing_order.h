// A fill-reducing order that the nodes of a cut join, without another call of METIS.
//
//   rank(node of the first mesh) = its place in METIS's order,   rank(new) = rank(origin(new))
//   origin(new): of the corners that its tetrahedra had before it, and lost to it, the one of the lowest rank
//
// A duplicate thus stands beside its twin, and the new node of a split edge beside the end that is eliminated
// first: its neighbours are neighbours of that end, so no separator is crossed. The order is by rank, and of
// equal ones by number. Cost: `follow` counts what was cut, `order` the nodes.
#pragma once

#include <span>
#include <vector>

#include "physics/compliance/system_matrix.h"

namespace hapticd {

class GrowingOrder {
 public:
  // `fill_order`: of the nodes in use.
  explicit GrowingOrder(std::span<const int> fill_order);

  // Takes in the nodes that these tetrahedra brought into use. `before`: an earlier mesh's elements.
  void follow(const TissueModel& model, std::span<const SystemMatrix::Element> before,
              std::span<const int> tets);

  int node_count() const noexcept { return static_cast<int>(rank_.size()); }
  int origin(int node) const noexcept { return origin_[node]; }  // of the first mesh's: itself
  std::vector<int> order() const;

 private:
  std::vector<int> rank_, origin_;  // per node in use
};

}  // namespace hapticd
