// The tetrahedra around each node, following cuts and removals.
//
// One singly linked list for each node. Its links are the places 4·tet + corner, so linking never allocates.
// Tetrahedra that died are forgotten when their node is looked at next.
// Cost of every call: the node's star. Guarantee: no allocation after construction.
#pragma once

#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

class StarIndex {
 public:
  explicit StarIndex(const TissueModel& model);

  // The live tetrahedra of the node, ascending. Pre: `star` has room for them.
  void live(const TissueState& state, int node, std::vector<int>& star) noexcept;

  // The node's list becomes empty.
  void clear(int node) noexcept { head_[node] = -1; }
  void link(int node, int tet, int corner) noexcept;
  void unlink(int node, int tet, int corner) noexcept;

 private:
  std::vector<int> head_;  // per node: the first place, or −1
  std::vector<int> next_;  // per place
};

}  // namespace hapticd
