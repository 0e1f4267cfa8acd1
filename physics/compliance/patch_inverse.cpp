#include "physics/compliance/patch_inverse.h"

#include <algorithm>
#include <numeric>

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
}

void PatchInverse::operator()(const Corner& L, std::span<const int> places, std::span<const int> outside,
                              const MatX& Y, Eigen::Ref<MatX> block) {
  if (outside.empty()) return operator()(L, places, block);
  invert(L, places, block);
  const int out = static_cast<int>(outside.size()), inside = static_cast<int>(sorted_.size());
  D_.noalias() = Y.transpose() * Y;
  for (int i = 0; i < out; ++i)
    for (int j = 0; j <= i; ++j) put(block, outside[i], outside[j], D_.block<3, 3>(3 * i, 3 * j));
  for (int j = 0; j < inside; j += panel) {
    const int nodes = std::min(panel, inside - j);
    const Eigen::Index height = L.rows() - 3 * places[sorted_[j]];
    D_.noalias() = Y.bottomRows(height).transpose() * X_.block(L.rows() - height, 3 * j, height, 3 * nodes);
    for (int k = 0; k < nodes; ++k)
      for (int i = 0; i < out; ++i) put(block, outside[i], sorted_[j + k], D_.block<3, 3>(3 * i, 3 * k));
  }
}

void PatchInverse::invert(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block) {
  sorted_.clear();
  for (int k = 0; k < static_cast<int>(places.size()); ++k)
    if (places[k] >= 0) sorted_.push_back(k);
  std::sort(sorted_.begin(), sorted_.end(), [&](int a, int b) { return places[a] < places[b]; });
  const int count = static_cast<int>(sorted_.size());
  const Eigen::Index size = L.rows();

  if (X_.rows() < size || X_.cols() < 3 * count) X_.resize(size, 3 * count);
  if (C_.rows() < 3 * count) C_.resize(3 * count, 3 * count);
  for (int j = 0; j < count; j += panel) {
    const int width = 3 * std::min(panel, count - j);
    const Eigen::Index top = 3 * places[sorted_[j]];
    const Eigen::Index height = size - top;
    auto X = X_.block(top, 3 * j, height, width);
    X.setZero();
    for (int k = 0; k < width; ++k) X(3 * places[sorted_[j + k / 3]] + k % 3 - top, k) = 1.0;
    L.bottomRightCorner(height, height).triangularView<Eigen::Lower>().solveInPlace(X);
    // Against this and all earlier panels, from this panel's first row on: above it X is zero.
    C_.block(3 * j, 0, width, 3 * j + width).noalias() =
        X.transpose() * X_.block(top, 0, height, 3 * j + width);
  }

  block.setZero();
  for (int i = 0; i < count; ++i)
    for (int j = 0; j <= i; ++j) put(block, sorted_[i], sorted_[j], C_.block<3, 3>(3 * i, 3 * j));
}

}  // namespace hapticd
