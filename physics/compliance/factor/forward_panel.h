// One front of a forward solve with several right-hand sides.
//
//   own ← L11⁻¹ own,   below ← L21 own
//
// Few right-hand sides wait for L from memory: panel_kernels.h reads it once and packs nothing. Many wait for
// arithmetic: Eigen's products. Shapes: panel height × width, column-major, L11 its first `width` rows; own
// width rows, below height − width. Allocates where `below` grows.
#pragma once

#include <cstddef>

#include "physics/compliance/factor/panel_kernels.h"
#include "physics/types.h"

namespace hapticd {

inline void forward_panel(const double* panel, std::ptrdiff_t stride, int width, int height,
                          Eigen::Ref<MatX> own, MatX& below) {
  constexpr Eigen::Index few = 15;  // from 36 on Eigen is as quick, or quicker
  if (own.cols() > few) {
    const Eigen::Map<const MatX, 0, Eigen::OuterStride<>> L(panel, height, width,
                                                            Eigen::OuterStride<>(stride));
    L.topRows(width).triangularView<Eigen::Lower>().solveInPlace(own);
    below.noalias() = L.bottomRows(height - width) * own;
    return;
  }
  const int ld = static_cast<int>(stride), sides = static_cast<int>(own.cols());
  panels::solve_lower(panel, ld, width, own.data(), own.outerStride(), sides);
  below.setZero(height - width, sides);
  panels::add_product(panel + width, ld, height - width, width, own.data(), own.outerStride(), below.data(),
                      below.rows(), sides);
}

}  // namespace hapticd
