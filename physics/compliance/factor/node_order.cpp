#include "physics/compliance/factor/node_order.h"

#include <cholmod.h>

#include <algorithm>
#include <numeric>
#include <span>
#include <stdexcept>

namespace hapticd {

NodeGraph node_graph(const TissueModel& model) {
  const std::span<const Tet> tets = std::span(model.mesh.tets).first(model.tets_in_use);
  const auto each_pair = [&](const auto& use) {
    for (const Tet& tet : tets)
      for (const int a : tet)
        for (const int b : tet)
          if (a != b && !model.fixed[a] && !model.fixed[b]) use(a, b);
    if (!model.condensed) return;
    for (const int a : model.condensed->node)
      for (const int b : model.condensed->node)
        if (a != b) use(a, b);
  };
  std::vector<int> first(model.nodes_in_use + 1, 0);
  each_pair([&](int a, int) { ++first[a + 1]; });
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<int> named(first.back());  // by each tetrahedron that joins them
  std::vector<int> next(first.begin(), first.end() - 1);
  each_pair([&](int a, int b) { named[next[a]++] = b; });

  NodeGraph graph;
  graph.start.assign(1, 0);
  graph.start.reserve(first.size());
  graph.neighbour.reserve(named.size() / 3);
  for (int n = 0; n < model.nodes_in_use; ++n) {
    const auto begin = named.begin() + first[n], end = named.begin() + first[n + 1];
    std::sort(begin, end);
    graph.neighbour.insert(graph.neighbour.end(), begin, std::unique(begin, end));
    graph.start.push_back(static_cast<int>(graph.neighbour.size()));
  }
  return graph;
}

std::vector<int> connected_pieces(const NodeGraph& graph) {
  std::vector<int> piece(graph.node_count(), -1), reached;
  for (int first = 0; first < graph.node_count(); ++first) {
    if (piece[first] >= 0) continue;
    piece[first] = first;
    reached.assign(1, first);
    while (!reached.empty()) {
      const int n = reached.back();
      reached.pop_back();
      for (const int other : graph.of(n)) {
        if (piece[other] >= 0) continue;
        piece[other] = first;
        reached.push_back(other);
      }
    }
  }
  return piece;
}

std::vector<int> fill_reducing_order(const NodeGraph& graph) {
  const int n = graph.node_count();
  std::vector<int> order(n);
  std::iota(order.begin(), order.end(), 0);
  if (graph.neighbour.empty()) return order;

  cholmod_common common;
  cholmod_start(&common);
  common.print = 0;
  cholmod_sparse pattern{};
  std::vector<int> start = graph.start;
  std::vector<int> row;
  row.reserve(graph.neighbour.size());
  // CHOLMOD takes one triangle of a symmetric pattern.
  for (int j = 0; j < n; ++j) {
    start[j] = static_cast<int>(row.size());
    for (const int i : graph.of(j))
      if (i > j) row.push_back(i);
  }
  start[n] = static_cast<int>(row.size());
  pattern.nrow = pattern.ncol = static_cast<std::size_t>(n);
  pattern.nzmax = row.size();
  pattern.p = start.data();
  pattern.i = row.data();
  pattern.stype = -1;
  pattern.itype = CHOLMOD_INT;
  pattern.xtype = CHOLMOD_PATTERN;
  pattern.dtype = CHOLMOD_DOUBLE;
  pattern.sorted = 1;
  pattern.packed = 1;
  const int ok = cholmod_metis(&pattern, nullptr, 0, 1, order.data(), &common);
  cholmod_finish(&common);
  if (!ok) throw std::runtime_error("METIS could not order the body's nodes");
  return order;
}

namespace {

// Elimination tree of the graph under an order, in places of that order (Liu 1990); -1 at roots.
std::vector<int> elimination_tree(const NodeGraph& graph, std::span<const int> order,
                                  std::span<const int> place) {
  const int n = graph.node_count();
  std::vector<int> parent(n, -1);
  std::vector<int> ancestor(n, -1);
  for (int j = 0; j < n; ++j)
    for (const int neighbour : graph.of(order[j])) {
      int i = place[neighbour];
      while (i >= 0 && i < j) {
        const int next = ancestor[i];
        ancestor[i] = j;
        if (next < 0) parent[i] = j;
        i = next;
      }
    }
  return parent;
}

// Postorder of the forest of the first `count` places, the child of the largest subtree next to its parent.
std::vector<int> postorder(std::span<const int> parent, int count) {
  std::vector<int> weight(count, 1);
  for (int j = 0; j < count; ++j)
    if (parent[j] >= 0 && parent[j] < count) weight[parent[j]] += weight[j];
  std::vector<int> by_weight(count);
  std::iota(by_weight.begin(), by_weight.end(), 0);
  std::stable_sort(by_weight.begin(), by_weight.end(), [&](int a, int b) { return weight[a] < weight[b]; });

  // Pushing light children last makes the list of each parent end, and so its walk begin, with the lightest.
  std::vector<int> first_child(count, -1);
  std::vector<int> sibling(count, -1);
  std::vector<int> roots;
  for (auto it = by_weight.rbegin(); it != by_weight.rend(); ++it) {
    const int j = *it;
    if (parent[j] < 0 || parent[j] >= count) {
      roots.push_back(j);
    } else {
      sibling[j] = first_child[parent[j]];
      first_child[parent[j]] = j;
    }
  }
  std::vector<int> result;
  result.reserve(count);
  std::vector<int> stack;
  for (auto root = roots.rbegin(); root != roots.rend(); ++root) {
    stack.push_back(*root);
    while (!stack.empty()) {
      const int j = stack.back();
      if (first_child[j] < 0) {
        result.push_back(j);
        stack.pop_back();
      } else {
        stack.push_back(first_child[j]);
        first_child[j] = sibling[first_child[j]];
      }
    }
  }
  return result;
}

}  // namespace

std::vector<int> zone_last_order(const NodeGraph& graph, std::span<const int> fill_order,
                                 std::span<const int> zone) {
  const int n = graph.node_count();
  const int rest = n - static_cast<int>(zone.size());
  std::vector<bool> in_zone(n, false);
  for (const int node : zone) in_zone[node] = true;
  std::vector<int> order;
  order.reserve(n);
  for (const int node : fill_order)
    if (!in_zone[node]) order.push_back(node);
  order.insert(order.end(), zone.rbegin(), zone.rend());

  std::vector<int> place(n);
  for (int j = 0; j < n; ++j) place[order[j]] = j;
  const std::vector<int> parent = elimination_tree(graph, order, place);
  std::vector<int> result = order;
  const std::vector<int> post = postorder(parent, rest);
  for (int j = 0; j < rest; ++j) result[j] = order[post[j]];
  return result;
}

}  // namespace hapticd
