#include <algorithm>

#include "physics/compliance/factor/forward_panel.h"
#include "physics/compliance/factor/multifrontal_factor.h"
#include "physics/compliance/factor/panel_kernels.h"

namespace hapticd {

// x₁ ← L11⁻¹ x₁, x₂ ← x₂ − L21 x₁. Of contacts' forces, nearly all is zero.
void MultifrontalFactor::forward(const FrontPlan::Front& front) noexcept {
  double* t = gathered_.data();
  const double* panel = values_.data() + front.panel;
  const int stride = static_cast<int>(front.stride);
  const int count = front.size - front.width;
  double* own = x_.data() + front.first;
  if (std::all_of(own, own + front.width, [](double x) { return x == 0; })) return;
  panels::solve_lower(panel, stride, front.width, own);
  std::fill_n(t, count, 0.0);
  panels::add_product(panel + front.width, stride, count, front.width, own, t);
  const int* row = plan_.below.data() + front.below;
  for (int i = 0; i < count; ++i) x_[row[i]] -= t[i];
}

// x₁ ← L11⁻ᵀ (x₁ − L21ᵀ x₂)
void MultifrontalFactor::backward(const FrontPlan::Front& front) noexcept {
  double* t = gathered_.data();
  const double* panel = values_.data() + front.panel;
  const int stride = static_cast<int>(front.stride);
  const int count = front.size - front.width;
  double* own = x_.data() + front.first;
  const int* row = plan_.below.data() + front.below;
  for (int i = 0; i < count; ++i) t[i] = x_[row[i]];
  panels::subtract_transposed(panel + front.width, stride, count, front.width, t, own);
  panels::solve_upper(panel, stride, front.width, own);
}

// Forward, children before parents; backward, parents before children.
void MultifrontalFactor::solve() noexcept {
  for (const FrontPlan::Front& front : plan_.fronts) forward(front);
  for (auto front = plan_.fronts.rbegin(); front != plan_.fronts.rend(); ++front) backward(*front);
}

// Of the last front, those columns alone that were eliminated; what was not is below them.
void MultifrontalFactor::reduce() noexcept {
  for (std::size_t s = 0; s + 1 < plan_.fronts.size(); ++s) forward(plan_.fronts[s]);
  const FrontPlan::Front& last = plan_.fronts.back();
  const int eliminated = last.width - kept_, stride = static_cast<int>(last.stride);
  const double* panel = values_.data() + last.panel;
  double *own = x_.data() + last.first, *t = gathered_.data();
  panels::solve_lower(panel, stride, eliminated, own);
  std::fill_n(t, kept_, 0.0);
  panels::add_product(panel + eliminated, stride, kept_, eliminated, own, t);
  for (int i = 0; i < kept_; ++i) own[eliminated + i] -= t[i];
}

void MultifrontalFactor::extend() noexcept {
  x_.head(x_.size() - kept_).setZero();
  const FrontPlan::Front& last = plan_.fronts.back();
  const int eliminated = last.width - kept_, stride = static_cast<int>(last.stride);
  const double* panel = values_.data() + last.panel;
  double* own = x_.data() + last.first;
  panels::subtract_transposed(panel + eliminated, stride, kept_, eliminated, own + eliminated, own);
  panels::solve_upper(panel, stride, eliminated, own);
  for (auto front = plan_.fronts.rbegin() + 1; front != plan_.fronts.rend(); ++front) backward(*front);
}

// Forward alone, all columns at a time. A node's entries reach its own front and those above it, no others.
void MultifrontalFactor::half_solve(std::span<const int> places, MatX& Y) {
  const auto columns = static_cast<Eigen::Index>(3 * places.size());
  Y.setZero(x_.size(), columns);
  reached_.assign(plan_.fronts.size(), 0);
  const auto reach = [&](int row) {
    const auto next = std::upper_bound(plan_.fronts.begin(), plan_.fronts.end(), row,
                                       [](int r, const FrontPlan::Front& f) { return r < f.first; });
    reached_[static_cast<std::size_t>(next - plan_.fronts.begin()) - 1] = 1;
  };
  for (std::size_t k = 0; k < places.size(); ++k) {
    const Eigen::Index row = 3 * places[k];
    Y.block<3, 3>(row, static_cast<Eigen::Index>(3 * k)).setIdentity();
    reach(static_cast<int>(row));
  }
  for (std::size_t s = 0; s < plan_.fronts.size(); ++s) {
    if (!reached_[s]) continue;
    const FrontPlan::Front& front = plan_.fronts[s];
    const int count = front.size - front.width;
    forward_panel(values_.data() + front.panel, front.stride, front.width, front.size,
                  Y.middleRows(front.first, front.width), below_);
    if (count == 0) continue;
    const int* row = plan_.below.data() + front.below;
    for (Eigen::Index c = 0; c < columns; ++c)
      for (int i = 0; i < count; ++i) Y(row[i], c) -= below_(i, c);
    reach(row[0]);
  }
}

}  // namespace hapticd
