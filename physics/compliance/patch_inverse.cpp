#include "physics/compliance/patch_inverse.h"

#include <algorithm>
#include <numeric>
#include <vector>

namespace hapticd {
namespace {

constexpr std::size_t large = 200;  // nodes: more than an instrument's patch has
constexpr int panel = 16;           // nodes

// Of nodes i and j, in a symmetric block.
void put(Eigen::Ref<MatX> block, int i, int j, Mat3 entry) {
  if (i == j) entry.triangularView<Eigen::StrictlyUpper>() = entry.transpose();
  block.block<3, 3>(3 * i, 3 * j) = entry;
  block.block<3, 3>(3 * j, 3 * i) = entry.transpose();
}

// The places that are coupled, by the lowest of them.
void find_components(const PatchInverse::Corner& L, std::vector<int>& of) {
  const int count = static_cast<int>(L.rows() / 3);
  of.resize(count);
  std::iota(of.begin(), of.end(), 0);
  const auto root = [&](int i) {
    while (of[i] != i) i = of[i] = of[of[i]];
    return i;
  };
  for (int j = 0; j < count; ++j)
    for (int i = j + 1; i < count; ++i) {
      const int a = root(j), b = root(i);
      if (a != b && !L.block<3, 3>(3 * i, 3 * j).isZero(0)) of[std::max(a, b)] = std::min(a, b);
    }
  for (int i = 0; i < count; ++i) of[i] = root(i);
}

}  // namespace

void PatchInverse::operator()(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block) {
  if (places.size() <= large) return invert(L, places, block);
  std::vector<int> component;  // per place
  find_components(L, component);
  if (std::all_of(component.begin(), component.end(), [](int c) { return c == 0; }))
    return invert(L, places, block);
  block.setZero();
  MatX own_L, own_block;
  std::vector<int> rows, at(component.size()), nodes, own_places;
  for (int c = 0; c < static_cast<int>(component.size()); ++c) {
    if (component[c] != c) continue;
    rows.clear();
    for (int i = c; i < static_cast<int>(component.size()); ++i)
      if (component[i] == c) {
        at[i] = static_cast<int>(rows.size());
        rows.push_back(i);
      }
    nodes.clear();
    own_places.clear();
    for (int k = 0; k < static_cast<int>(places.size()); ++k)
      if (places[k] >= 0 && component[places[k]] == c) {
        nodes.push_back(k);
        own_places.push_back(at[places[k]]);
      }
    if (nodes.empty()) continue;
    const auto size = static_cast<Eigen::Index>(rows.size()), own = static_cast<Eigen::Index>(nodes.size());
    own_L.resize(3 * size, 3 * size);
    for (Eigen::Index j = 0; j < size; ++j)
      for (Eigen::Index i = j; i < size; ++i)
        own_L.block<3, 3>(3 * i, 3 * j) = L.block<3, 3>(3 * rows[i], 3 * rows[j]);
    own_block.resize(3 * own, 3 * own);
    invert(own_L, own_places, own_block);
    for (Eigen::Index j = 0; j < own; ++j)
      for (Eigen::Index i = 0; i < own; ++i)
        block.block<3, 3>(3 * nodes[i], 3 * nodes[j]) = own_block.block<3, 3>(3 * i, 3 * j);
  }
  panels_.clear();  // they are of the last piece alone
}

void PatchInverse::operator()(const Corner& L, std::span<const int> places, std::span<const int> outside,
                              const MatX& Y, bool same_L, Eigen::Ref<MatX> block) {
  if (places.size() > large) same_L = false;
  if (outside.empty() && !same_L) return operator()(L, places, block);
  if (same_L && known_nodes() > 2 * static_cast<int>(places.size()) + panel)
    same_L = false;  // most have gone by
  if (!same_L) panels_.clear();
  add_columns(L, places);
  gather(places, block);
  const int out = static_cast<int>(outside.size());
  D_.noalias() = Y.transpose() * Y;
  for (int i = 0; i < out; ++i)
    for (int j = 0; j <= i; ++j) put(block, outside[i], outside[j], D_.block<3, 3>(3 * i, 3 * j));
  std::vector<int> of(known_nodes(), -1);  // in the patch
  for (int k = 0; k < static_cast<int>(places.size()); ++k)
    if (places[k] >= 0) of[column_[places[k]]] = k;
  for (const Panel& p : panels_) {
    const auto first = of.begin() + p.first;
    if (out == 0 || std::all_of(first, first + p.nodes, [](int k) { return k < 0; })) continue;
    const Eigen::Index height = L.rows() - p.top;
    D_.noalias() = Y.bottomRows(height).transpose() * X_.block(p.top, 3 * p.first, height, 3 * p.nodes);
    for (int k = 0; k < p.nodes; ++k)
      for (int i = 0; i < out && first[k] >= 0; ++i)
        put(block, outside[i], first[k], D_.block<3, 3>(3 * i, 3 * k));
  }
}

void PatchInverse::invert(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block) {
  panels_.clear();
  add_columns(L, places);
  gather(places, block);
}

int PatchInverse::known_nodes() const {
  return panels_.empty() ? 0 : panels_.back().first + panels_.back().nodes;
}

void PatchInverse::add_columns(const Corner& L, std::span<const int> places) {
  if (panels_.empty()) column_.assign(static_cast<std::size_t>(L.rows() / 3), -1);
  new_.clear();
  for (const int place : places)
    if (place >= 0 && column_[place] < 0) new_.push_back(place);
  std::sort(new_.begin(), new_.end());
  new_.erase(std::unique(new_.begin(), new_.end()), new_.end());
  const int known = known_nodes();
  const Eigen::Index columns = 3 * static_cast<Eigen::Index>(known + new_.size());
  if (X_.rows() < L.rows() || X_.cols() < columns)
    X_.conservativeResize(std::max(X_.rows(), L.rows()), std::max(X_.cols(), columns + columns / 4));
  if (C_.rows() < columns) C_.conservativeResize(columns + columns / 4, columns + columns / 4);
  const std::span<const int> all(new_);
  for (std::size_t j = 0; j < all.size(); j += panel)
    add_panel(L, all.subspan(j, std::min<std::size_t>(panel, all.size() - j)));
}

void PatchInverse::add_panel(const Corner& L, std::span<const int> places) {
  const int first = known_nodes(), nodes = static_cast<int>(places.size());
  const Eigen::Index top = 3 * places[0], height = L.rows() - top, width = 3 * nodes;
  auto X = X_.block(top, 3 * first, height, width);
  X.setZero();
  for (int k = 0; k < nodes; ++k) {
    for (int c = 0; c < 3; ++c) X(3 * places[k] + c - top, 3 * k + c) = 1;
    column_[places[k]] = first + k;
  }
  L.bottomRightCorner(height, height).triangularView<Eigen::Lower>().solveInPlace(X);
  // Against itself and all before it, from where both are known.
  panels_.push_back({first, nodes, top});
  for (std::size_t p = 0, q = 0; p < panels_.size(); p = q) {
    const Eigen::Index from = std::max(top, panels_[p].top);
    for (q = p + 1; q < panels_.size() && std::max(top, panels_[q].top) == from;) ++q;
    const Eigen::Index begin = 3 * panels_[p].first;
    const Eigen::Index end = 3 * (panels_[q - 1].first + panels_[q - 1].nodes);
    C_.block(3 * first, begin, width, end - begin).noalias() =
        X.bottomRows(L.rows() - from).transpose() * X_.block(from, begin, L.rows() - from, end - begin);
  }
}

void PatchInverse::gather(std::span<const int> places, Eigen::Ref<MatX> block) const {
  block.setZero();
  for (int i = 0; i < static_cast<int>(places.size()); ++i)
    for (int j = 0; j <= i; ++j) {
      if (places[i] < 0 || places[j] < 0) continue;
      const int a = 3 * column_[places[i]], b = 3 * column_[places[j]];
      put(block, i, j, a >= b ? Mat3(C_.block<3, 3>(a, b)) : Mat3(C_.block<3, 3>(b, a).transpose()));
    }
}

}  // namespace hapticd
