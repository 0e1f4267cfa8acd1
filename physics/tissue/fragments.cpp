#include "physics/tissue/fragments.h"

#include <algorithm>
#include <numeric>

namespace hapticd {

namespace {

int root_of(std::vector<int>& parent, int node) {
  while (parent[node] != node) {
    parent[node] = parent[parent[node]];
    node = parent[node];
  }
  return node;
}

// Numbers of the live tetrahedra, by the root of `key(t)`, in the order of the lowest.
template <typename Key>
std::vector<int> numbered(const TissueState& state, std::vector<int>& parent, const Key& key) {
  std::vector<int> label(state.alive.size(), -1);
  std::vector<int> label_of_root(parent.size(), -1);
  int labels = 0;
  for (int t = 0; t < static_cast<int>(label.size()); ++t) {
    if (!state.alive[t]) continue;
    int& of_root = label_of_root[root_of(parent, key(t))];
    if (of_root < 0) of_root = labels++;
    label[t] = of_root;
  }
  return label;
}

// Live tetrahedra that faces join to `first`, in the order in which they are met; one more than `most` where
// there are more.
std::vector<int> joined_to(const TissueModel& model, const TissueState& state, int first, int most) {
  std::vector<int> joined = {first};
  for (std::size_t k = 0; k < joined.size(); ++k)
    for (int id = 4 * joined[k]; id < 4 * joined[k] + 4; ++id) {
      const int neighbour = model.across[id] / 4;
      if (model.across[id] < 0 || !state.alive[neighbour] ||
          std::find(joined.begin(), joined.end(), neighbour) != joined.end())
        continue;
      joined.push_back(neighbour);
      if (static_cast<int>(joined.size()) > most) return joined;
    }
  return joined;
}

// Of a whole fragment: it can turn about what it hangs on. That is springs and the nodes of others, where
// nothing holds it firmly, or fewer than three nodes.
bool hangs(const TissueModel& model, const TissueState& state, std::span<const int> fragment) {
  std::vector<int> corners;
  for (const int t : fragment)
    corners.insert(corners.end(), model.mesh.tets[t].begin(), model.mesh.tets[t].end());
  std::sort(corners.begin(), corners.end());
  int firm = 0, hung = 0;
  for (auto n = corners.begin(); n != corners.end();) {
    const auto next = std::upper_bound(n, corners.end(), *n);
    firm += model.fixed[*n] || (model.condensed && model.condensed->place_of(*n) >= 0);
    hung += model.holds(*n) || next - n < state.live_tets_of_node[*n];
    n = next;
  }
  return hung > 0 && (firm == 0 || hung < 3);
}

}  // namespace

std::vector<int> label_fragments(const TissueModel& model, const TissueState& state) {
  std::vector<int> parent(model.tet_count());
  std::iota(parent.begin(), parent.end(), 0);
  for (int t = 0; t < model.tet_count(); ++t) {
    if (!state.alive[t]) continue;
    for (int id = 4 * t; id < 4 * t + 4; ++id) {
      const int neighbour = model.across[id] / 4;
      if (model.across[id] >= 0 && state.alive[neighbour])
        parent[root_of(parent, neighbour)] = root_of(parent, t);
    }
  }
  return numbered(state, parent, [](int t) { return t; });
}

std::vector<int> label_pieces(const TissueModel& model, const TissueState& state) {
  std::vector<int> parent(model.node_count());
  std::iota(parent.begin(), parent.end(), 0);
  for (int t = 0; t < model.tet_count(); ++t) {
    if (!state.alive[t]) continue;
    const Tet& tet = model.mesh.tets[t];
    for (int a = 1; a < 4; ++a) parent[root_of(parent, tet[a])] = root_of(parent, tet[0]);
  }
  // Condensed tissue joins all that it meets: what one of them does the others feel.
  if (model.condensed)
    for (const int n : model.condensed->node)
      parent[root_of(parent, n)] = root_of(parent, model.condensed->node.front());
  return numbered(state, parent, [&](int t) { return model.mesh.tets[t][0]; });
}

Pieces find_pieces(const TissueModel& model, const TissueState& state) {
  Pieces pieces;
  pieces.of_tet = label_pieces(model, state);
  pieces.of_node.assign(model.mesh.nodes.size(), -1);
  for (std::size_t t = 0; t < pieces.of_tet.size(); ++t) {
    const int p = pieces.of_tet[t];
    if (p < 0) continue;
    if (p >= pieces.count()) pieces.held.resize(static_cast<std::size_t>(p) + 1, 0);
    for (const int n : model.mesh.tets[t]) {
      pieces.of_node[n] = p;
      if (model.holds(n)) pieces.held[p] = 1;
    }
  }
  if (!model.condensed) return pieces;
  // Its boundary is that piece's, where nothing near is left of it too.
  int joined = -1;
  for (const int n : model.condensed->node) joined = std::max(joined, pieces.of_node[n]);
  for (const int n : model.condensed->node) pieces.of_node[n] = joined;
  return pieces;
}

std::vector<Fragment> find_fragments(const TissueModel& model, const TissueState& state) {
  const std::vector<int> label = label_fragments(model, state);
  std::vector<Fragment> fragments;
  for (int t = 0; t < model.tet_count(); ++t) {
    if (label[t] < 0) continue;
    if (label[t] == static_cast<int>(fragments.size())) fragments.emplace_back();
    Fragment& fragment = fragments[label[t]];
    const Tet& tet = model.mesh.tets[t];
    fragment.tets.push_back(t);
    fragment.volume += model.volume[t];
    fragment.held |= std::any_of(tet.begin(), tet.end(), [&](int n) { return model.holds(n); });
  }
  return fragments;
}

std::vector<int> hinged_fragments(const TissueModel& model, const TissueState& state,
                                  std::span<const int> changed, int most) {
  std::vector<int> hinged;
  const auto look_at = [&](int t) {
    if (!state.alive[t] || std::find(hinged.begin(), hinged.end(), t) != hinged.end()) return;
    const std::vector<int> fragment = joined_to(model, state, t, most);
    if (static_cast<int>(fragment.size()) <= most && hangs(model, state, fragment))
      hinged.insert(hinged.end(), fragment.begin(), fragment.end());
  };
  for (const int t : changed) {
    if (state.alive[t]) {
      look_at(t);
      continue;
    }
    for (int id = 4 * t; id < 4 * t + 4; ++id)
      if (model.across[id] >= 0) look_at(model.across[id] / 4);
  }
  return hinged;
}

}  // namespace hapticd
