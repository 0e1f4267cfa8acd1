// New nodes join the fill-reducing order where they came from.
#include "physics/compliance/growing_order.h"

#include <gtest/gtest.h>

#include "tests/physics/compliance/cut_by_hand.h"

namespace hapticd {
namespace {

TEST(GrowingOrder, ADuplicateFollowsItsTwinAndAMiddleTheFirstOfItsEnds) {
  TissueModel model = by_hand::box_with_room(3, {20, 80});
  TissueState state = rest_state(model);
  const NodeGraph graph = node_graph(model);
  const SystemMatrix matrix(model, graph, oracle::h);
  const std::vector<int> first = fill_reducing_order(graph);
  GrowingOrder order(first);
  EXPECT_EQ(order.order(), first);
  const auto place = [&](int n) {
    const std::vector<int> now = order.order();
    return std::find(now.begin(), now.end(), n) - now.begin();
  };
  const int node = 37;
  order.follow(model, matrix.elements(), by_hand::open_node(model, state, node, Vec3(1, 0.1, 0.2)));
  const int twin = model.nodes_in_use - 1;
  EXPECT_EQ(order.origin(twin), node);
  EXPECT_EQ(place(twin), place(node) + 1);

  const int a = 41, b = 42;
  order.follow(model, matrix.elements(), by_hand::split_edge(model, state, a, b));
  const int middle = model.nodes_in_use - 1, end = place(a) < place(b) ? a : b;
  EXPECT_EQ(order.origin(middle), end);
  EXPECT_EQ(place(middle), place(end) + 1);
  // A twin's twin stands with them.
  const SystemMatrix later(model, node_graph(model), oracle::h);
  order.follow(model, later.elements(), by_hand::open_node(model, state, twin, Vec3(-0.1, 1, 0.2)));
  EXPECT_EQ(place(model.nodes_in_use - 1), place(node) + 2);
  EXPECT_EQ(order.order().size(), static_cast<std::size_t>(model.nodes_in_use));
}

}  // namespace
}  // namespace hapticd
