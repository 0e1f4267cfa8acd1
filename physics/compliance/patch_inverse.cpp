#include "physics/compliance/patch_inverse.h"

#include <algorithm>
#include <numeric>
#include <vector>

namespace hapticd {
namespace {

constexpr std::size_t large = 200;  // nodes: more than an instrument's patch has
constexpr int tile = most_tile_rows;

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
  forget();  // what is known is of the last piece alone
}

void PatchInverse::operator()(const Corner& L, std::span<const int> places, std::span<const int> outside,
                              const MatX& half_solved, bool same_L, Eigen::Ref<MatX> block) {
  if (places.size() > large) same_L = false;
  if (outside.empty() && !same_L) return operator()(L, places, block);
  if (same_L && rows() > 6 * static_cast<int>(places.size()) + 2 * tile) same_L = false;  // most have gone by
  if (!same_L) forget();
  add_rows(L, places);
  gather(places, block);
  if (outside.empty()) return;
  const int out = static_cast<int>(outside.size());
  D_.noalias() = half_solved.transpose() * half_solved;
  for (int i = 0; i < out; ++i)
    for (int j = 0; j <= i; ++j) put(block, outside[i], outside[j], D_.block<3, 3>(3 * i, 3 * j));
  std::vector<int> of(begins_.size() / 3, -1);  // in the patch
  for (int k = 0; k < static_cast<int>(places.size()); ++k)
    if (places[k] >= 0) of[row_[places[k]] / 3] = k;
  for (int row = 0; row < rows(); row += tile) {
    const auto first = of.begin() + row / 3;
    if (std::all_of(first, first + tile / 3, [](int k) { return k < 0; })) continue;
    const Eigen::Index height = L.rows() - begins_[row];
    D_.noalias() =
        half_solved.bottomRows(height).transpose() * Y_.block(row, begins_[row], tile, height).transpose();
    for (int k = 0; k < tile / 3; ++k)
      for (int i = 0; i < out && first[k] >= 0; ++i)
        put(block, outside[i], first[k], D_.block<3, 3>(3 * i, 3 * k));
  }
}

void PatchInverse::invert(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block) {
  forget();
  add_rows(L, places);
  gather(places, block);
}

// Whole tiles, so that none has rows of two calls.
void PatchInverse::add_rows(const Corner& L, std::span<const int> places) {
  const Eigen::Index size = L.rows();
  if (begins_.empty()) row_.assign(static_cast<std::size_t>(size / 3), -1);
  new_.clear();
  for (const int place : places)
    if (place >= 0 && row_[place] < 0) new_.push_back(place);
  std::sort(new_.begin(), new_.end());
  new_.erase(std::unique(new_.begin(), new_.end()), new_.end());
  if (new_.empty()) return;
  const int first = rows(), last = first + 3 * static_cast<int>(new_.size());
  const int end = first + (last - first + tile - 1) / tile * tile;
  begins_.resize(static_cast<std::size_t>(end), static_cast<int>(size));
  make_room(end, size);
  for (std::size_t k = 0; k < new_.size(); ++k) {
    const int row = row_[new_[k]] = first + 3 * static_cast<int>(k);
    for (int c = 0; c < 3; ++c) begins_[row + c] = 3 * new_[k] + c;
  }
  for (int row = first; row < end; row += tile) {
    const int begin = begins_[row] / row_multiple * row_multiple;
    Y_.block(row, begin, tile, size - begin).setZero();
    for (int r = row; r < std::min(row + tile, last); ++r) Y_(r, begins_[r]) = 1;
  }
  kernels_->solve_rows(L.data(), L.outerStride(), static_cast<int>(size), begins_.data(), first, end,
                       Y_.data(), Y_.rows(), inverses_.data());
  kernels_->multiply_rows(Y_.data(), Y_.rows(), static_cast<int>(size), begins_.data(), first, end, C_.data(),
                          C_.rows());
}

void PatchInverse::make_room(int rows, Eigen::Index size) {
  // Columns an odd number of cache lines apart.
  const auto odd = [](Eigen::Index n) {
    return n / (2 * row_multiple) * (2 * row_multiple) + 3 * row_multiple;
  };
  if (Y_.rows() < rows || Y_.cols() < size)
    Y_.conservativeResize(std::max(Y_.rows(), odd(std::max<Eigen::Index>(rows, size))),
                          std::max(Y_.cols(), size));
  if (C_.rows() < rows) C_.conservativeResize(odd(rows + rows / 4), odd(rows + rows / 4));
  inverses_.resize(std::max(inverses_.size(), static_cast<std::size_t>((row_multiple + 1) * size)));
}

// The lower triangle column by column, then its mirror image tile by tile.
void PatchInverse::gather(std::span<const int> places, Eigen::Ref<MatX> block) const {
  const int count = static_cast<int>(places.size());
  for (int j = 0; j < count; ++j)
    for (int i = j; i < count; ++i) {
      auto entry = block.block<3, 3>(3 * i, 3 * j);
      if (places[i] < 0 || places[j] < 0) {
        entry.setZero();
        continue;
      }
      const int a = row_[places[i]], b = row_[places[j]];
      if (a >= b)
        entry = -C_.block<3, 3>(a, b);
      else
        entry = -C_.block<3, 3>(b, a).transpose();
    }
  constexpr int nodes = 8;
  for (int j = 0; j < count; j += nodes) {
    const int columns = 3 * std::min(nodes, count - j);
    auto own = block.block(3 * j, 3 * j, columns, columns);
    own.triangularView<Eigen::StrictlyUpper>() = own.transpose();
    for (int i = j + nodes; i < count; i += nodes) {
      const int rows = 3 * std::min(nodes, count - i);
      block.block(3 * j, 3 * i, columns, rows) = block.block(3 * i, 3 * j, rows, columns).transpose();
    }
  }
}

}  // namespace hapticd
