// The panel is [S; N; E], `definite` columns wide: factor_panel turns it into [L; N̂; Ê]. Of the contribution
// block −[N̂; Ê][N̂; Ê]ᵀ the columns of N̂ are made, lower triangle: among them is all of −Ê N̂ᵀ, whose
// transpose the corner takes.
#include "physics/contact/solver/bordered_factor.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "physics/contact/solver/small_factors.h"

namespace hapticd {
namespace {

constexpr int rounded_up(int rows) noexcept {
  return (rows + row_multiple - 1) / row_multiple * row_multiple;
}

}  // namespace

// With stride ≤ most + 16 and border ≤ most / 3 the panel, corner and contribution block never take more than
// a panel without border does, but for the rounding of their columns.
BorderedFactor::BorderedFactor(int most)
    : data_(static_cast<std::size_t>(most + 32) * static_cast<std::size_t>(most)),
      reciprocal_(most),
      pivot_(most) {}

void BorderedFactor::resize(int definite, int border) noexcept {
  definite_ = definite;
  border_ = border;
  height_ = rounded_up(definite + 2 * border);
  stride_ = height_ | row_multiple;  // an odd multiple: columns do not share cache sets
  const int rows = definite + 2 * border;
  for (int k = 0; k < definite; ++k) std::fill(column(k) + rows, column(k) + height_, 0.0);
  for (int j = 0; j < border; ++j) std::fill(corner(j) + border, corner(j) + padded(border), 0.0);
}

std::ptrdiff_t BorderedFactor::corner_at() const noexcept {
  return static_cast<std::ptrdiff_t>(definite_) * stride_;
}

double* BorderedFactor::corner(int j) noexcept {
  return panel() + corner_at() + static_cast<std::ptrdiff_t>(j) * padded(border_);
}

double BorderedFactor::flops(double d, double b) noexcept {
  return d * d * (d / 3 + 2 * b) + 3 * d * b * b + 2.0 / 3 * b * b * b;
}

bool BorderedFactor::factor(const FrontKernels& kernels) noexcept {
  FrontAhead nothing;
  if (definite_ > 0 &&
      !kernels.factor_panel(panel(), stride_, height_, definite_, reciprocal_.data(), nothing))
    return false;
  if (border_ > 0) {
    const int origin = contribution_origin(definite_), rows = height_ - origin;
    double* block = corner(border_);
    if (definite_ > 0) {
      kernels.make_contribution(panel(), stride_, height_, definite_, definite_ + border_, block, rows,
                                nothing);
      const int first = definite_ + border_ - origin;
      for (int j = 0; j < border_; ++j) {
        double* T = corner(j);
        for (int i = 0; i < border_; ++i) T[i] += block[first + j + static_cast<std::ptrdiff_t>(i) * rows];
      }
    }
    if (!lu_factor(corner(0), border_, pivot_.data())) return false;
  }
  return judge_pivots();
}

bool BorderedFactor::judge_pivots() noexcept {
  double least = std::numeric_limits<double>::infinity(), largest = 0;
  bool finite = true;
  const auto take = [&](double pivot) {
    finite = finite && std::isfinite(pivot);
    least = std::min(least, pivot);
    largest = std::max(largest, pivot);
  };
  for (int k = 0; k < definite_; ++k) take(column(k)[k] * column(k)[k]);
  for (int j = 0; j < border_; ++j) take(std::abs(corner(j)[j]));
  pivot_ratio_ = largest > 0 ? least / largest : 1;
  return finite;
}

void BorderedFactor::solve(double* b) const noexcept {
  const int size = definite_ + border_;
  lower_solve(panel(), stride_, definite_, size, b);
  if (border_ > 0) {
    lu_solve(panel() + corner_at(), border_, pivot_.data(), b + definite_);
    std::copy_n(b + definite_, border_, b + size);
    std::fill_n(b + definite_, border_, 0.0);
  }
  lower_transposed_solve(panel(), stride_, definite_, size + border_, b);
  std::copy_n(b + size, border_, b + definite_);
}

}  // namespace hapticd
