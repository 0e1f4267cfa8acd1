#include "physics/compliance/patch_inverse.h"

#include <algorithm>

namespace hapticd {

void PatchInverse::operator()(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block) {
  constexpr int panel = 16;  // nodes
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
    for (int j = 0; j <= i; ++j) {
      Mat3 entry = C_.block<3, 3>(3 * i, 3 * j);
      if (i == j) entry.triangularView<Eigen::StrictlyUpper>() = entry.transpose();
      block.block<3, 3>(3 * sorted_[i], 3 * sorted_[j]) = entry;
      block.block<3, 3>(3 * sorted_[j], 3 * sorted_[i]) = entry.transpose();
    }
}

}  // namespace hapticd
