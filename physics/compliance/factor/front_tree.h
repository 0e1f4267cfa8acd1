// Which nodes are eliminated together: the elimination tree of the node graph, amalgamated into fronts.
//
//   below(j) = {i > j adjacent to j} ∪ ⋃_children below(c) \ {j},   parent(j) = min below(j)
//
// A front is a set of nodes with one list of nodes below them. At first each node is a front of its own, but
// the nodes of the zone, which are one, the last, or one for each connected piece (ZoneFronts). Then, from
// the leaves up, a child goes into its parent where the model of time below says that it pays: chains always
// do (nothing is filled in), small relatives often (a little fill is cheaper than another front). Any child
// may, not the last only, for the order inside a front is free; the nodes are renumbered afterwards so that
// fronts are contiguous, children come before parents, and the zone stays last in its order. Time of a front
// of w columns and m rows (unknowns), in cycles of the machine in README.md:
//   t = Σ_{j<w} (m − j)² / 2 / rate + panel · w m + contribution block · (m − w)² / 2 + front
// Source: Liu, The multifrontal method for sparse matrix solution, SIAM Review 34 (1992); Ashcraft & Grimes,
// The influence of relaxed supernode partitions, ACM TOMS 15 (1989). Departure: a model of time, not of
// zeros.
#pragma once

#include <span>
#include <vector>

#include "physics/compliance/factor/node_order.h"

namespace hapticd {

struct FrontTree {
  struct Front {
    int first = 0;           // place of its first node
    int width = 0;           // nodes
    int parent = -1;         // front; -1: a root
    std::vector<int> below;  // places, ascending
  };
  std::vector<int> order;     // nodes by place
  std::vector<Front> fronts;  // children before parents, each subtree contiguous; the zone's come last
};

struct FrontCost {
  double rate = 20;           // products a cycle
  double panel = 0.6;         // per entry of the panel: cleared, assembled, written
  double contribution = 0.5;  // per entry of the contribution block: written, added to the parent
  double front = 800;

  double operator()(int width, int height) const noexcept;  // nodes
};

// each_piece: of the zone's order as much is one front as has no piece in common with the rest; so a front
// for each, where the order goes by pieces. Other nodes of its piece may then come before a front's zone.
enum class ZoneFronts { one, each_piece };

// Contract: `order` names every node once; its last `zone` nodes are the zone.
FrontTree front_tree(const NodeGraph& graph, std::span<const int> order, int zone, const FrontCost& cost = {},
                     ZoneFronts zone_fronts = ZoneFronts::one);

}  // namespace hapticd
