// LU of a matrix that is symmetric and positive definite but for a border.
//
//   M = [S Eᵀ]    S = L Lᵀ,   N̂ = N L⁻ᵀ,   Ê = E L⁻ᵀ,   T − N̂ Êᵀ = LU with row exchanges
//       [N T ]
//
// S (definite × definite) needs no exchange, and only its lower triangle. [S; N; E] is the panel of one
// front, so its arithmetic is that of front_kernels.h, chosen by what the processor can do; the rest is
// small_factors.h. With a tenth of 150 to 250 unknowns in the border it takes 0.4 of the time of a plain LU,
// with a third 0.6 (AVX-512).
// Usage: resize, write every column and corner, factor, solve as often as wanted.
// Guarantee: wait-free, no allocation after construction, definite²(definite/3 + 2 border) + 3 definite ·
// border² + 2 border³/3 flops. Rounding, and nothing else, differs between processors.
#pragma once

#include <vector>

#include "physics/compliance/factor/front_kernels.h"
#include "physics/contact/solver/aligned_numbers.h"

namespace hapticd {

class BorderedFactor {
 public:
  // For definite + 2 · border ≤ most and border ≤ most / 3.
  explicit BorderedFactor(int most);

  void resize(int definite, int border) noexcept;

  // Column k of [S; N; E], to be written from row first_row(k) on. first_row(k) ≤ k, a multiple of 8.
  double* column(int k) noexcept { return panel() + static_cast<std::ptrdiff_t>(k) * stride_; }
  static constexpr int first_row(int k) noexcept { return k / row_multiple * row_multiple; }
  double* corner(int j) noexcept;  // column j of T

  // False where S is not positive definite or the rest singular, to working precision, or any pivot not
  // finite.
  [[nodiscard]] bool factor(const FrontKernels& kernels = front_kernels()) noexcept;

  // b ← M⁻¹ b in its first definite + border numbers; `border` more are scratch.
  void solve(double* b) const noexcept;

  static double flops(double definite, double border) noexcept;
  // Of the least to the largest pivot of LU, small where M is nearly singular.
  double pivot_ratio() const noexcept { return pivot_ratio_; }

 private:
  double* panel() noexcept { return data_.data(); }
  const double* panel() const noexcept { return data_.data(); }
  std::ptrdiff_t corner_at() const noexcept;  // after the panel
  bool judge_pivots() noexcept;

  AlignedNumbers data_;  // panel, corner, contribution block
  std::vector<double> reciprocal_;
  std::vector<int> pivot_;
  int definite_ = 0, border_ = 0;
  int height_ = 0, stride_ = 0;
  double pivot_ratio_ = 1;
};

}  // namespace hapticd
