#include "physics/compliance/factor/front_tree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>
#include <set>

namespace hapticd {
namespace {

NodeGraph graph_of(int nodes, const std::vector<std::pair<int, int>>& edges) {
  std::vector<std::set<int>> neighbours(nodes);
  for (const auto& [i, j] : edges) {
    neighbours[i].insert(j);
    neighbours[j].insert(i);
  }
  NodeGraph graph;
  graph.start = {0};
  for (const std::set<int>& list : neighbours) {
    graph.neighbour.insert(graph.neighbour.end(), list.begin(), list.end());
    graph.start.push_back(static_cast<int>(graph.neighbour.size()));
  }
  return graph;
}

// Prices under which nothing is merged, and under which everything is.
const FrontCost fronts_for_nothing{1e-6, 0, 0, 0};
const FrontCost fronts_beyond_price{1e6, 0, 0, 1e6};

TEST(FrontTree, ThreeNodesByHand) {
  // 0 – 1 – 2, ends first: both ends have the middle below them, and become its children.
  const NodeGraph path = graph_of(3, {{0, 1}, {1, 2}});
  const FrontTree tree = front_tree(path, std::vector<int>{0, 2, 1}, 0, fronts_for_nothing);
  ASSERT_EQ(tree.fronts.size(), 3U);
  EXPECT_EQ(tree.order.back(), 1);
  for (int s = 0; s < 2; ++s) {
    EXPECT_EQ(tree.fronts[s].parent, 2);
    EXPECT_EQ(tree.fronts[s].below, std::vector<int>{2});
  }
  EXPECT_EQ(tree.fronts[2].parent, -1);
  EXPECT_TRUE(tree.fronts[2].below.empty());

  // The middle first: the ends become neighbours, a chain, which is one dense front whatever the price.
  const FrontTree chain = front_tree(path, std::vector<int>{1, 0, 2}, 0);
  ASSERT_EQ(chain.fronts.size(), 1U);
  EXPECT_EQ(chain.fronts[0].width, 3);
  EXPECT_EQ(chain.order, (std::vector<int>{1, 0, 2}));
}

TEST(FrontTree, TheZoneIsOneFrontInItsOrderAndOrphansAreRoots) {
  // 0 touches 1; 2 touches nobody; the zone 4, 3, 1 has no edges of its own.
  const NodeGraph graph = graph_of(5, {{0, 1}});
  const FrontTree tree = front_tree(graph, std::vector<int>{2, 0, 4, 3, 1}, 3, fronts_for_nothing);
  ASSERT_EQ(tree.fronts.size(), 3U);
  const FrontTree::Front& zone = tree.fronts.back();
  EXPECT_EQ(zone.width, 3);
  EXPECT_EQ(std::vector<int>(tree.order.end() - 3, tree.order.end()), (std::vector<int>{4, 3, 1}));
  for (int s = 0; s < 2; ++s) {
    const bool orphan = tree.order[tree.fronts[s].first] == 2;
    EXPECT_EQ(tree.fronts[s].parent, orphan ? -1 : 2);
    EXPECT_EQ(tree.fronts[s].below, orphan ? std::vector<int>{} : std::vector<int>{4});
  }
}

TEST(FrontTree, OfEachPieceTheZoneIsAFrontOfItsOwn) {
  // Pieces 0 – 1 – 2 and 3 – 4, and 5; the zone 1, 4, 5 is in all three. Whatever is merged, the zone's
  // fronts are the last, and have nothing in common.
  const NodeGraph graph = graph_of(6, {{0, 1}, {1, 2}, {3, 4}});
  for (const FrontCost& cost : {fronts_for_nothing, FrontCost{}, fronts_beyond_price}) {
    const FrontTree tree =
        front_tree(graph, std::vector<int>{0, 3, 2, 1, 4, 5}, 3, cost, ZoneFronts::each_piece);
    ASSERT_GE(tree.fronts.size(), 3U);
    const std::size_t first = tree.fronts.size() - 3;
    for (std::size_t s = first; s < tree.fronts.size(); ++s) {
      const FrontTree::Front& front = tree.fronts[s];
      EXPECT_EQ(tree.order[front.first + front.width - 1], (std::vector<int>{1, 4, 5}[s - first]));
      EXPECT_EQ(front.parent, -1);
      EXPECT_TRUE(front.below.empty());
    }
    for (std::size_t s = 0; s < first; ++s)
      EXPECT_EQ(tree.fronts[s].parent,
                static_cast<int>(tree.order[tree.fronts[s].first] == 3 ? first + 1 : first));
  }
  // Of an order that mingles them, what has a piece in common is one front.
  const FrontTree mingled =
      front_tree(graph, std::vector<int>{1, 5, 0, 3, 2, 4}, 4, fronts_for_nothing, ZoneFronts::each_piece);
  EXPECT_EQ(mingled.fronts.back().width, 4);
}

// At any price: every node once, children first, and whatever two nodes share is inside some front.
TEST(FrontTree, EveryEliminationFitsItsFront) {
  std::mt19937 random(5);
  for (int trial = 0; trial < 60; ++trial) {
    const int nodes = 1 + static_cast<int>(random() % 40);
    std::vector<std::pair<int, int>> edges;
    for (int e = 0; e < 2 * nodes; ++e) {
      const int i = static_cast<int>(random() % nodes);
      const int j = static_cast<int>(random() % nodes);
      if (i != j) edges.emplace_back(i, j);
    }
    std::vector<int> order(nodes);
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(order.begin(), order.end(), random);
    const int zone = static_cast<int>(random() % (nodes + 1));
    for (const FrontCost& cost : {fronts_for_nothing, FrontCost{}, fronts_beyond_price}) {
      const FrontTree tree = front_tree(graph_of(nodes, edges), order, zone, cost);
      std::vector<int> place(nodes, -1);
      for (int k = 0; k < nodes; ++k) place[tree.order[k]] = k;
      EXPECT_EQ(std::count(place.begin(), place.end(), -1), 0);
      EXPECT_TRUE(std::equal(order.end() - zone, order.end(), tree.order.end() - zone));
      std::vector<int> front_of(nodes);
      int next = 0;
      for (int s = 0; s < static_cast<int>(tree.fronts.size()); ++s) {
        const FrontTree::Front& front = tree.fronts[s];
        EXPECT_EQ(front.first, next);
        next += front.width;
        for (int k = front.first; k < next; ++k) front_of[k] = s;
        EXPECT_TRUE(front.parent == -1 || front.parent > s);
        EXPECT_EQ(front.parent == -1, front.below.empty());
      }
      const auto has = [&](int s, int k) {
        const FrontTree::Front& front = tree.fronts[s];
        return (k >= front.first && k < front.first + front.width) ||
               std::binary_search(front.below.begin(), front.below.end(), k);
      };
      for (const auto& [i, j] : edges)
        EXPECT_TRUE(has(front_of[std::min(place[i], place[j])], std::max(place[i], place[j])));
      for (const FrontTree::Front& front : tree.fronts)
        for (const int k : front.below) EXPECT_TRUE(has(front.parent, k));
    }
  }
}

}  // namespace
}  // namespace hapticd
