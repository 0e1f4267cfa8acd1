#include "physics/compliance/factor/front_tree.h"

#include <algorithm>

namespace hapticd {

double FrontCost::operator()(int width, int height) const noexcept {
  const double w = 3.0 * width;
  const double m = 3.0 * height;
  const double b = m - w;
  return (m * m * m - b * b * b) / 6 / rate + panel * w * m + contribution * b * b / 2 + front;
}

namespace {

// Fronts while they are made: numbered by the place of their last node, the zone's from `rest` on.
struct Growing {
  std::vector<int> nodes;  // places
  std::vector<int> below;
  std::vector<int> children;
  int parent = -1;
};

// For each of the zone's places, from `rest` on, the number of its front.
std::vector<int> fronts_of_zone(const NodeGraph& graph, std::span<const int> order, int zone,
                                ZoneFronts zone_fronts) {
  std::vector<int> front(zone, 0);
  if (zone_fronts == ZoneFronts::one) return front;
  const std::vector<int> piece = connected_pieces(graph);
  std::vector<int> last(graph.node_count(), -1);  // of the zone's places, by piece
  const std::span<const int> nodes = order.last(zone);
  for (int k = 0; k < zone; ++k) last[piece[nodes[k]]] = k;
  for (int k = 0, end = 0, number = -1; k < zone; ++k) {
    if (k == end) ++number;
    end = std::max({end, k + 1, last[piece[nodes[k]]] + 1});
    front[k] = number;
  }
  return front;
}

std::vector<Growing> elimination_tree(const NodeGraph& graph, std::span<const int> order, int zone,
                                      ZoneFronts zone_fronts) {
  const int n = graph.node_count();
  const int rest = n - zone;
  std::vector<int> place(n);
  for (int j = 0; j < n; ++j) place[order[j]] = j;
  const std::vector<int> of_zone = fronts_of_zone(graph, order, zone, zone_fronts);
  std::vector<Growing> fronts(zone > 0 ? rest + 1 + of_zone.back() : rest);
  std::vector<int> seen(n, -1);
  for (int j = 0; j < rest; ++j) {
    Growing& front = fronts[j];
    front.nodes = {j};
    seen[j] = j;
    const auto add = [&](int i) {
      if (i < j || seen[i] == j) return;
      seen[i] = j;
      front.below.push_back(i);
    };
    for (const int neighbour : graph.of(order[j])) add(place[neighbour]);
    for (const int child : front.children)
      for (const int i : fronts[child].below) add(i);
    if (front.below.empty()) continue;
    const int next = *std::min_element(front.below.begin(), front.below.end());
    front.parent = next < rest ? next : rest + of_zone[next - rest];
    fronts[front.parent].children.push_back(j);
  }
  for (int j = rest; j < n; ++j) fronts[rest + of_zone[j - rest]].nodes.push_back(j);
  return fronts;
}

void amalgamate(std::vector<Growing>& fronts, const FrontCost& cost) {
  std::vector<int> keep;
  for (std::size_t p = 0; p < fronts.size(); ++p) {
    Growing& parent = fronts[p];
    int below = static_cast<int>(parent.below.size());
    const auto gain = [&](int c) {
      const Growing& child = fronts[c];
      const int mine = static_cast<int>(parent.nodes.size());
      const int its = static_cast<int>(child.nodes.size());
      return cost(mine, mine + below) + cost(its, its + static_cast<int>(child.below.size())) -
             cost(mine + its, mine + its + below);
    };
    while (!parent.children.empty()) {
      const auto best = std::max_element(parent.children.begin(), parent.children.end(),
                                         [&](int a, int b) { return gain(a) < gain(b); });
      if (!(gain(*best) > 0)) break;
      Growing child = std::move(fronts[*best]);
      fronts[*best] = {};
      parent.children.erase(best);
      parent.nodes.insert(parent.nodes.end(), child.nodes.begin(), child.nodes.end());
      parent.children.insert(parent.children.end(), child.children.begin(), child.children.end());
      for (const int c : child.children) fronts[c].parent = static_cast<int>(p);
    }
    std::sort(parent.nodes.begin(), parent.nodes.end());
  }
}

// Fronts by postorder, those from `rest` on last.
std::vector<int> postorder(const std::vector<Growing>& fronts, int rest) {
  std::vector<int> stack;
  for (int root = static_cast<int>(fronts.size()) - 1; root >= 0; --root)
    if (fronts[root].parent < 0 && !fronts[root].nodes.empty()) stack.push_back(root);
  // A reversed walk from each root, then turned round: parents last.
  std::vector<int> walk;
  std::reverse(stack.begin(), stack.end());
  while (!stack.empty()) {
    const int f = stack.back();
    stack.pop_back();
    walk.push_back(f);
    stack.insert(stack.end(), fronts[f].children.begin(), fronts[f].children.end());
  }
  std::vector<int> result(walk.rbegin(), walk.rend());
  std::stable_partition(result.begin(), result.end(), [&](int f) { return f < rest; });
  return result;
}

// Inside a front any order does, so nodes that are below the same fronts become neighbours, the tallest
// fronts first: what goes from a child to its parent goes in longer runs. The zone keeps its order.
void sort_nodes(std::vector<Growing>& fronts, std::span<const int> sequence, int nodes, int zone) {
  std::vector<int> tallest(sequence.begin(), sequence.end());
  std::stable_sort(tallest.begin(), tallest.end(),
                   [&](int a, int b) { return fronts[a].below.size() > fronts[b].below.size(); });
  std::vector<std::vector<int>> is_below(nodes);
  for (std::size_t rank = 0; rank < tallest.size(); ++rank)
    for (const int i : fronts[tallest[rank]].below) is_below[i].push_back(static_cast<int>(rank));
  for (const int f : sequence) {
    std::vector<int>& list = fronts[f].nodes;
    const auto end = std::lower_bound(list.begin(), list.end(), nodes - zone);
    std::stable_sort(list.begin(), end, [&](int a, int b) { return is_below[a] < is_below[b]; });
  }
}

}  // namespace

FrontTree front_tree(const NodeGraph& graph, std::span<const int> order, int zone, const FrontCost& cost,
                     ZoneFronts zone_fronts) {
  std::vector<Growing> fronts = elimination_tree(graph, order, zone, zone_fronts);
  amalgamate(fronts, cost);
  const std::vector<int> sequence = postorder(fronts, graph.node_count() - zone);
  sort_nodes(fronts, sequence, graph.node_count(), zone);

  FrontTree tree;
  tree.fronts.resize(sequence.size());
  std::vector<int> new_place(graph.node_count());
  std::vector<int> number(fronts.size(), -1);
  for (std::size_t s = 0; s < sequence.size(); ++s) {
    const Growing& front = fronts[sequence[s]];
    number[sequence[s]] = static_cast<int>(s);
    tree.fronts[s].first = static_cast<int>(tree.order.size());
    tree.fronts[s].width = static_cast<int>(front.nodes.size());
    for (const int j : front.nodes) {
      new_place[j] = static_cast<int>(tree.order.size());
      tree.order.push_back(order[j]);
    }
  }
  for (std::size_t s = 0; s < sequence.size(); ++s) {
    const Growing& front = fronts[sequence[s]];
    std::vector<int>& below = tree.fronts[s].below;
    for (const int i : front.below) below.push_back(new_place[i]);
    std::sort(below.begin(), below.end());
    if (front.parent >= 0) tree.fronts[s].parent = number[front.parent];
  }
  return tree;
}

}  // namespace hapticd
