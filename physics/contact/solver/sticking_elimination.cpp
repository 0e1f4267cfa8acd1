#include "physics/contact/solver/sticking_elimination.h"

#include <algorithm>
#include <limits>

#include "physics/contact/solver/coulomb_newton.h"
#include "physics/contact/solver/small_factors.h"

namespace hapticd {
namespace {

constexpr int rounded_up(int rows) noexcept {
  return (rows + row_multiple - 1) / row_multiple * row_multiple;
}

// Of a panel or block with so many rows and columns at the most.
constexpr std::size_t room(int contacts) noexcept {
  const auto rows = static_cast<std::size_t>(3 * contacts);
  return (rows + 4 * row_multiple) * rows;
}

}  // namespace

StickingElimination::StickingElimination(int contacts)
    : sticking_(contacts),
      others_(contacts),
      row_(3 * contacts),
      panel_(room(contacts)),
      block_(room(contacts)),
      S_(static_cast<std::size_t>(9) * contacts * contacts),
      reciprocal_(3 * contacts),
      b_(3 * contacts),
      step_(3 * contacts) {}

void StickingElimination::clear() noexcept {
  r_ = p_ = 0;
  version_ = 0;
}

void StickingElimination::take(int contact, bool sticks) noexcept {
  if (sticks)
    sticking_[r_++] = contact;
  else
    others_[p_++] = contact;
}

bool StickingElimination::kept(const CoulombSystem& s) const noexcept {
  return version_ != 0 && version_ == s.version && epsilon_ == s.epsilon && contacts_ == s.contacts;
}

double StickingElimination::flops() const noexcept {
  const double r = 3 * r_, p = 3 * p_;
  return r * r * (r / 3 + p) + r * p * p;
}

bool StickingElimination::factor(const CoulombSystem& s, const FrontKernels& kernels) noexcept {
  version_ = 0;
  const int width = 3 * r_, size = width + 3 * p_, height = rounded_up(size);
  stride_ = height | row_multiple;  // an odd multiple: columns do not share cache sets
  for (int k = 0; k < size; ++k) row_[k] = 3 * (k < width ? sticking_[k / 3] : others_[k / 3 - r_]) + k % 3;
  for (int k = 0; k < size; k += 3) s.columns.ask(row_[k] / 3);
  const auto column_of_W = [&](int k) { return s.W.data() + row_[k] * s.W.outerStride(); };
  for (int k = 0; k < width; ++k) {
    double* const out = panel_.data() + static_cast<std::ptrdiff_t>(k) * stride_;
    const double* const w = column_of_W(k);
    for (int i = k / row_multiple * row_multiple; i < size; ++i) out[i] = w[row_[i]];
    std::fill(out + size, out + height, 0.0);
    out[k] += s.diagonal(row_[k] / 3);
  }
  FrontAhead nothing;
  if (!kernels.factor_panel(panel_.data(), stride_, height, width, reciprocal_.data(), nothing)) return false;
  double least = std::numeric_limits<double>::infinity(), largest = 0;
  for (int k = 0; k < width; ++k) {
    const double pivot = panel_.data()[k * static_cast<std::ptrdiff_t>(stride_ + 1)];
    least = std::min(least, pivot * pivot);
    largest = std::max(largest, pivot * pivot);
  }
  pivot_ratio_ = least / largest;

  const int origin = contribution_origin(width), rows = height - origin, of_others = size - width;
  if (of_others > 0)
    kernels.make_contribution(panel_.data(), stride_, height, width, size, block_.data(), rows, nothing);
  for (int j = 0; j < of_others; ++j) {
    const double* const w = column_of_W(width + j);
    const double* const added = block_.data() + static_cast<std::ptrdiff_t>(j) * rows + (width - origin);
    const auto at = [&](int i, int k) -> double& { return S_[static_cast<std::size_t>(k) * of_others + i]; };
    for (int i = j; i < of_others; ++i) at(i, j) = at(j, i) = w[row_[width + i]] + added[i];
    at(j, j) += s.diagonal(row_[width + j] / 3);
  }
  version_ = s.version;
  contacts_ = s.contacts;
  epsilon_ = s.epsilon;
  return true;
}

void StickingElimination::reduce(const CoulombSystem& s) noexcept {
  const int size = 3 * (r_ + p_);
  for (int k = 0; k < size; ++k) {
    const int row = row_[k];
    b_[k] = s.q[row] - (s.anchor ? s.diagonal(row / 3) * s.anchor[row] : 0);
  }
  lower_solve(panel_.data(), stride_, 3 * r_, size, b_.data());
}

// Lᵀ λ_R = −(L⁻¹ q_R + L⁻¹ A_RP λ_P).
void StickingElimination::recover(const double* of_others, std::span<double> lambda) noexcept {
  const int width = 3 * r_, of_P = 3 * p_;
  for (int k = 0; k < width; ++k) step_[k] = -b_[k];
  std::copy_n(of_others, of_P, step_.data() + width);
  lower_transposed_solve(panel_.data(), stride_, width, width + of_P, step_.data());
  std::fill(lambda.begin(), lambda.end(), 0.0);
  for (int k = 0; k < width + of_P; ++k) lambda[row_[k]] = step_[k];
}

}  // namespace hapticd
