// The order in which nodes are eliminated: fill-reducing once, with the zone near the instrument last.
//
//   order = postorder of (fill-reducing order without the zone), then the zone
//
// Moving the zone costs no new METIS call. The rest is postordered in its own elimination forest (the tree
// cut where it enters the zone): the same fill, but each supernode contiguous, and the zone stays last, which
// a postorder of the whole tree would break. Nodes that a cut takes into use join the order beside the ones
// they came from (growing_order.h). Shapes: an order lists nodes, first eliminated first.
#pragma once

#include <span>
#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

// Neighbours of each node, ascending, without itself. Fixed nodes have none: they do not couple.
struct NodeGraph {
  std::vector<int> start;      // nodes + 1
  std::vector<int> neighbour;  // start.back()

  int node_count() const noexcept { return static_cast<int>(start.size()) - 1; }
  std::span<const int> of(int node) const noexcept {
    return {neighbour.data() + start[node], neighbour.data() + start[node + 1]};
  }
};

// Of the nodes in use.
NodeGraph node_graph(const TissueModel& model);

// By node: the first of those that it is connected with.
std::vector<int> connected_pieces(const NodeGraph& graph);

// METIS nested dissection. Throws std::runtime_error when it fails.
std::vector<int> fill_reducing_order(const NodeGraph& graph);

// Contract: `zone` has no duplicates. Its first node is eliminated last of all.
std::vector<int> zone_last_order(const NodeGraph& graph, std::span<const int> fill_order,
                                 std::span<const int> zone);

}  // namespace hapticd
