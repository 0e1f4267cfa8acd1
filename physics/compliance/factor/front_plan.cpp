#include "physics/compliance/factor/front_plan.h"

#include <algorithm>

namespace hapticd {

namespace {

int padded(int rows) { return (rows + row_multiple - 1) / row_multiple * row_multiple; }

std::ptrdiff_t stride_of(int padded_rows) {
  return padded_rows / row_multiple % 2 == 1 ? padded_rows : padded_rows + row_multiple;
}

void lay_out(const FrontTree& tree, FrontPlan& plan) {
  for (const FrontTree::Front& from : tree.fronts) {
    FrontPlan::Front front;
    front.first = 3 * from.first;
    front.width = 3 * from.width;
    front.size = front.width + 3 * static_cast<int>(from.below.size());
    front.height = padded(front.size);
    front.stride = stride_of(front.height);
    front.panel = plan.values;
    plan.values += front.stride * front.width;
    front.contribution_stride = stride_of(front.height - contribution_origin(front.width));
    front.below = static_cast<int>(plan.below.size());
    for (const int place : from.below)
      for (int r = 0; r < 3; ++r) plan.below.push_back(3 * place + r);
    front.below_end = static_cast<int>(plan.below.size());
    plan.widest = std::max(plan.widest, front.width);
    plan.tallest = std::max(plan.tallest, front.height);
    plan.fronts.push_back(front);
  }
}

void list_children(const FrontTree& tree, FrontPlan& plan) {
  std::vector<std::vector<int>> children(tree.fronts.size());
  for (std::size_t s = 0; s < tree.fronts.size(); ++s) {
    plan.children.insert(plan.children.end(), children[s].begin(), children[s].end());
    plan.fronts[s].children_end = static_cast<int>(plan.children.size());
    if (tree.fronts[s].parent >= 0) children[tree.fronts[s].parent].push_back(static_cast<int>(s));
  }
}

// Both stacks as they will grow and shrink; the second one's contribution blocks are moved behind the first's
// at the end. The zone's fronts, which come last, whatever subtrees theirs are, leave none.
void stack_contributions(const FrontTree& tree, FrontPlan& plan) {
  const int count = static_cast<int>(plan.fronts.size());
  std::vector<int> depth(count, 0);
  for (int s = count - 1; s >= 0; --s)
    if (tree.fronts[s].parent >= 0) depth[s] = (depth[tree.fronts[s].parent] + 1) % 2;
  std::ptrdiff_t top[2] = {0, 0};
  std::ptrdiff_t most[2] = {0, 0};
  int child = 0;
  for (int s = 0; s < count; ++s) {
    FrontPlan::Front& front = plan.fronts[s];
    // The first child's contribution block is the lowest of them: all above it is free once the front is
    // assembled.
    const bool leaf = child == front.children_end;
    const std::ptrdiff_t lowest = leaf ? 0 : plan.fronts[plan.children[child]].contribution;
    child = front.children_end;
    std::ptrdiff_t& mine = top[depth[s]];
    front.contribution = mine;
    mine += front.contribution_stride * (front.size - front.width);
    most[depth[s]] = std::max(most[depth[s]], mine);
    if (!leaf) top[1 - depth[s]] = lowest;
  }
  for (int s = 0; s < count; ++s)
    if (depth[s] == 1) plan.fronts[s].contribution += most[0];
  plan.workspace = most[0] + most[1];
}

// `local` gets the row in the front of each unknown that it has.
void number_rows(const FrontPlan& plan, const FrontPlan::Front& front, std::vector<int>& local) {
  for (int k = 0; k < front.width; ++k) local[front.first + k] = k;
  for (int k = front.below; k < front.below_end; ++k) local[plan.below[k]] = front.width + k - front.below;
}

void find_chunks(const FrontTree& tree, FrontPlan& plan, std::vector<int>& local) {
  for (std::size_t s = 0; s < plan.fronts.size(); ++s) {
    FrontPlan::Front& front = plan.fronts[s];
    if (tree.fronts[s].parent >= 0) {
      number_rows(plan, plan.fronts[tree.fronts[s].parent], local);
      int row = -1;
      for (int k = front.below; k < front.below_end; ++k) {
        const int to = local[plan.below[k]];
        if (to / row_multiple * row_multiple != row) {
          row = to / row_multiple * row_multiple;
          plan.chunks.push_back({row, k - front.below, 0});
        }
        plan.chunks.back().mask |= 1U << (to - row);
      }
    }
    front.chunks_end = static_cast<int>(plan.chunks.size());
  }
}

void place_couplings(const SystemMatrix& matrix, std::span<const std::uint8_t> live_edges, FrontPlan& plan,
                     std::vector<int>& local) {
  const auto& edges = matrix.edges();
  std::vector<std::vector<int>> of_place(plan.order.size());
  for (std::size_t e = 0; e < edges.size(); ++e) {
    if (!live_edges.empty() && !live_edges[e]) continue;
    of_place[std::min(plan.place[edges[e].i], plan.place[edges[e].j])].push_back(static_cast<int>(e));
  }
  for (FrontPlan::Front& front : plan.fronts) {
    number_rows(plan, front, local);
    for (int column = 0; column < front.width; column += 3) {
      const int own = (front.first + column) / 3;
      for (const int e : of_place[own]) {
        const bool transposed = plan.place[edges[e].i] == own;
        const int other = plan.place[transposed ? edges[e].j : edges[e].i];
        plan.couplings.push_back({e, transposed, front.panel + column * front.stride + local[3 * other]});
      }
    }
    front.couplings_end = static_cast<int>(plan.couplings.size());
  }
}

}  // namespace

FrontPlan plan_fronts(const SystemMatrix& matrix, std::span<const int> order,
                      std::span<const std::uint8_t> live_edges, int zone, ZoneFronts zone_fronts) {
  const std::vector<std::uint8_t> live =
      live_edges.empty() ? std::vector<std::uint8_t>(matrix.edges().size(), 1)
                         : std::vector<std::uint8_t>(live_edges.begin(), live_edges.end());
  const FrontTree tree = front_tree(matrix.graph_of(live), order, zone, {}, zone_fronts);
  FrontPlan plan;
  plan.order = tree.order;
  plan.place.resize(plan.order.size());
  for (std::size_t k = 0; k < plan.order.size(); ++k) plan.place[plan.order[k]] = static_cast<int>(k);
  lay_out(tree, plan);
  list_children(tree, plan);
  stack_contributions(tree, plan);
  std::vector<int> local(3 * plan.order.size());
  find_chunks(tree, plan, local);
  place_couplings(matrix, live, plan, local);
  return plan;
}

}  // namespace hapticd
