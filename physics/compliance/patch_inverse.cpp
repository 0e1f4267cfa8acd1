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
  constexpr int whole[] = {0};
  const auto invert = [&](const Corner& own, std::span<const int> own_places, Eigen::Ref<MatX> own_block) {
    operator()(own, whole, own_places, {}, {}, false, own_block);
  };
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
  pieces_ = 0;  // what is known is of the last piece alone
}

void PatchInverse::operator()(const Corner& L, std::span<const int> pieces, std::span<const int> places,
                              std::span<const int> outside, const MatX& half_solved, bool same_L,
                              Eigen::Ref<MatX> block) {
  int known = 0;
  for (std::size_t k = 0; k < pieces_; ++k) known += rows_[k].rows();
  // Or most of them have gone by.
  if (!same_L || pieces_ != pieces.size() || known > 6 * static_cast<int>(places.size()) + 2 * tile)
    begin(L.rows(), pieces);
  add_rows(L, places);
  gather(places, block);
  if (outside.empty()) return;
  const int out = static_cast<int>(outside.size());
  D_.noalias() = half_solved.transpose() * half_solved;
  for (int i = 0; i < out; ++i)
    for (int j = 0; j <= i; ++j) put(block, outside[i], outside[j], D_.block<3, 3>(3 * i, 3 * j));
  std::vector<int> of;  // in the patch
  for (std::size_t p = 0; p < pieces_; ++p) {
    const Rows& own = rows_[p];
    const auto size = static_cast<Eigen::Index>(3 * own.row.size());
    const Eigen::Index start = half_solved.rows() - L.rows() + 3 * own.start;
    of.assign(own.begins.size() / 3, -1);
    for (int k = 0; k < static_cast<int>(places.size()); ++k)
      if (places[k] >= 0 && piece_of_[places[k]] == static_cast<int>(p))
        of[own.row[places[k] - own.start] / 3] = k;
    for (int row = 0; row < own.rows(); row += tile) {
      const auto first = of.begin() + row / 3;
      if (std::all_of(first, first + tile / 3, [](int k) { return k < 0; })) continue;
      const Eigen::Index height = size - own.begins[row];
      D_.noalias() = half_solved.middleRows(start + own.begins[row], height).transpose() *
                     own.Y.block(row, own.begins[row], tile, height).transpose();
      for (int k = 0; k < tile / 3; ++k)
        for (int i = 0; i < out && first[k] >= 0; ++i)
          put(block, outside[i], first[k], D_.block<3, 3>(3 * i, 3 * k));
    }
  }
}

// Of a corner with so many rows, nothing is known.
void PatchInverse::begin(Eigen::Index size, std::span<const int> pieces) {
  pieces_ = pieces.size();
  rows_.resize(std::max(rows_.size(), pieces_));
  piece_of_.resize(static_cast<std::size_t>(size / 3));
  for (std::size_t k = 0; k < pieces_; ++k) {
    const auto end = k + 1 < pieces_ ? static_cast<std::size_t>(pieces[k + 1]) : piece_of_.size();
    const auto start = static_cast<std::size_t>(pieces[k]);
    rows_[k].start = pieces[k];
    rows_[k].row.assign(end - start, -1);
    rows_[k].begins.clear();
    std::fill(piece_of_.begin() + pieces[k], piece_of_.begin() + static_cast<std::ptrdiff_t>(end),
              static_cast<int>(k));
  }
}

void PatchInverse::add_rows(const Corner& L, std::span<const int> places) {
  for (std::size_t k = 0; k < pieces_; ++k) rows_[k].wanted.clear();
  for (const int place : places) {
    if (place < 0) continue;
    Rows& own = rows_[piece_of_[place]];
    if (own.row[place - own.start] < 0) own.wanted.push_back(place - own.start);
  }
  for (std::size_t k = 0; k < pieces_; ++k) {
    const auto size = static_cast<Eigen::Index>(3 * rows_[k].row.size());
    const Eigen::Index start = 3 * rows_[k].start;
    rows_[k].add(*kernels_, L.block(start, start, size, size));
  }
}

// Whole tiles, so that none has rows of two calls.
void PatchInverse::Rows::add(const FrontKernels& kernels, const Corner& L) {
  const Eigen::Index size = L.rows();
  std::sort(wanted.begin(), wanted.end());
  wanted.erase(std::unique(wanted.begin(), wanted.end()), wanted.end());
  if (wanted.empty()) return;
  const int first = rows(), last = first + 3 * static_cast<int>(wanted.size());
  const int end = first + (last - first + tile - 1) / tile * tile;
  begins.resize(static_cast<std::size_t>(end), static_cast<int>(size));
  make_room(end, size);
  for (std::size_t k = 0; k < wanted.size(); ++k) {
    const int own = row[wanted[k]] = first + 3 * static_cast<int>(k);
    for (int c = 0; c < 3; ++c) begins[own + c] = 3 * wanted[k] + c;
  }
  for (int r = first; r < end; r += tile) {
    const int begin = begins[r] / row_multiple * row_multiple;
    Y.block(r, begin, tile, size - begin).setZero();
    for (int i = r; i < std::min(r + tile, last); ++i) Y(i, begins[i]) = 1;
  }
  kernels.solve_rows(L.data(), L.outerStride(), static_cast<int>(size), begins.data(), first, end, Y.data(),
                     Y.rows(), inverses.data());
  kernels.multiply_rows(Y.data(), Y.rows(), static_cast<int>(size), begins.data(), first, end, C.data(),
                        C.rows());
}

void PatchInverse::Rows::make_room(int rows, Eigen::Index size) {
  // Columns an odd number of cache lines apart.
  const auto odd = [](Eigen::Index n) {
    return n / (2 * row_multiple) * (2 * row_multiple) + 3 * row_multiple;
  };
  if (Y.rows() < rows || Y.cols() < size)
    Y.conservativeResize(std::max(Y.rows(), odd(std::max<Eigen::Index>(rows, size))),
                         std::max(Y.cols(), size));
  if (C.rows() < rows) C.conservativeResize(odd(rows + rows / 4), odd(rows + rows / 4));
  inverses.resize(std::max(inverses.size(), static_cast<std::size_t>((row_multiple + 1) * size)));
}

// The lower triangle column by column, then its mirror image tile by tile.
void PatchInverse::gather(std::span<const int> places, Eigen::Ref<MatX> block) const {
  const int count = static_cast<int>(places.size());
  for (int j = 0; j < count; ++j)
    for (int i = j; i < count; ++i) {
      auto entry = block.block<3, 3>(3 * i, 3 * j);
      if (places[i] < 0 || places[j] < 0 || piece_of_[places[i]] != piece_of_[places[j]]) {
        entry.setZero();
        continue;
      }
      const Rows& own = rows_[piece_of_[places[i]]];
      const int a = own.row[places[i] - own.start], b = own.row[places[j] - own.start];
      if (a > b)
        entry = -own.C.block<3, 3>(a, b);
      else if (a == b)  // on the diagonal, or a node that the patch names twice
        entry = -Mat3(own.C.block<3, 3>(a, a).selfadjointView<Eigen::Lower>());
      else
        entry = -own.C.block<3, 3>(b, a).transpose();
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
