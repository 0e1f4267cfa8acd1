#include "physics/compliance/rest_panels.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "physics/compliance/panel_kernels.h"

namespace hapticd {

RestPanels::RestPanels(MultifrontalFactor&& factor, int rest_dofs, bool rounded_copy)
    : rest_dofs_(rest_dofs) {
  const FrontPlan& plan = factor.plan();
  panel_of_.resize(rest_dofs);
  int tallest = 0;
  for (const FrontPlan::Front& front : plan.fronts) {
    if (front.first >= rest_dofs) break;
    const int width = std::min(front.width, rest_dofs - front.first);
    std::fill_n(panel_of_.begin() + front.first, width, static_cast<int>(panel_.size()));
    panel_.push_back({front.first, width, front.size, static_cast<std::ptrdiff_t>(row_.size()), front.panel,
                      static_cast<int>(front.stride)});
    for (int k = 0; k < front.width; ++k) row_.push_back(front.first + k);
    row_.insert(row_.end(), plan.below.begin() + front.below, plan.below.begin() + front.below_end);
    tallest = std::max(tallest, front.size);
  }
  value_ = factor.take_values();
  if (rounded_copy) round();
  gathered_.resize(tallest);
  touched_.assign(panel_.size(), 0);
}

void RestPanels::round() {
  constexpr double largest = std::numeric_limits<std::int16_t>::max();
  std::size_t triangles = 0;
  std::size_t others = 0;
  for (Panel& p : panel_) {
    p.triangle = static_cast<std::ptrdiff_t>(triangles);
    p.other = static_cast<std::ptrdiff_t>(others);
    triangles += static_cast<std::size_t>(p.width) * p.width;
    others += static_cast<std::size_t>(p.width) * (p.height - p.width);
  }
  triangle_.reserve(triangles);
  other_.reserve(others);
  unit_.reserve(rest_dofs_);
  for (const Panel& p : panel_)
    for (int j = 0; j < p.width; ++j) {
      const double* column = value_.data() + p.value + static_cast<std::ptrdiff_t>(j) * p.stride;
      for (int i = 0; i < p.width; ++i) triangle_.push_back(static_cast<float>(column[i]));
      double most = 0;
      for (int i = p.width; i < p.height; ++i) most = std::max(most, std::abs(column[i]));
      const double unit = most > 0 ? most / largest : 1;
      unit_.push_back(static_cast<float>(unit));
      for (int i = p.width; i < p.height; ++i)
        other_.push_back(static_cast<std::int16_t>(std::lround(column[i] / unit)));
    }
  int tallest = 0;
  for (const Panel& p : panel_) tallest = std::max(tallest, p.height);
  single_.resize(2 * static_cast<std::size_t>(tallest));
}

void RestPanels::forward(VecX& x, PanelPrecision precision) noexcept {
  if (precision == PanelPrecision::rounded && has_rounded_copy())
    forward_rounded(x);
  else
    forward_full(x);
}

void RestPanels::backward(VecX& x, PanelPrecision precision) noexcept {
  if (precision == PanelPrecision::rounded && has_rounded_copy())
    backward_rounded(x);
  else
    backward_full(x);
}

void RestPanels::forward_full(VecX& x) noexcept {
  double* t = gathered_.data();
  for (const Panel& p : panel_) {
    const double* value = value_.data() + p.value;
    const int below = p.height - p.width;
    panels::solve_lower(value, p.stride, p.width, &x[p.first]);
    std::fill(t, t + below, 0.0);
    panels::add_product(value + p.width, p.stride, below, p.width, &x[p.first], t);
    const int* row = &row_[p.row + p.width];
    for (int i = 0; i < below; ++i) x[row[i]] -= t[i];
  }
}

void RestPanels::backward_full(VecX& x) noexcept {
  double* t = gathered_.data();
  for (auto p = panel_.rbegin(); p != panel_.rend(); ++p) {
    const double* value = value_.data() + p->value;
    const int below = p->height - p->width;
    const int* row = &row_[p->row + p->width];
    for (int i = 0; i < below; ++i) t[i] = x[row[i]];
    panels::subtract_transposed(value + p->width, p->stride, below, p->width, t, &x[p->first]);
    panels::solve_upper(value, p->stride, p->width, &x[p->first]);
  }
}

void RestPanels::forward_rounded(VecX& x) noexcept {
  float* own = single_.data();
  for (const Panel& p : panel_) {
    const int below = p.height - p.width;
    float* t = own + p.width;
    for (int j = 0; j < p.width; ++j) own[j] = static_cast<float>(x[p.first + j]);
    panels::solve_lower(&triangle_[p.triangle], p.width, p.width, own);
    for (int j = 0; j < p.width; ++j) {
      x[p.first + j] = own[j];
      own[j] *= unit_[p.first + j];
    }
    std::fill(t, t + below, 0.0F);
    panels::add_product(&other_[p.other], below, below, p.width, own, t);
    const int* row = &row_[p.row + p.width];
    for (int i = 0; i < below; ++i) x[row[i]] -= static_cast<double>(t[i]);
  }
}

void RestPanels::backward_rounded(VecX& x) noexcept {
  float* own = single_.data();
  for (auto p = panel_.rbegin(); p != panel_.rend(); ++p) {
    const int below = p->height - p->width;
    float* t = own + p->width;
    const int* row = &row_[p->row + p->width];
    for (int i = 0; i < below; ++i) t[i] = static_cast<float>(x[row[i]]);
    std::fill(own, own + p->width, 0.0F);
    panels::subtract_transposed(&other_[p->other], below, below, p->width, t, own);
    for (int j = 0; j < p->width; ++j)
      own[j] = static_cast<float>(x[p->first + j]) + unit_[p->first + j] * own[j];
    panels::solve_upper(&triangle_[p->triangle], p->width, p->width, own);
    for (int j = 0; j < p->width; ++j) x[p->first + j] = own[j];
  }
}

void RestPanels::forward_sparse(MatX& X, std::span<const int> nonzero, std::vector<int>& reached) {
  reached.clear();
  std::fill(touched_.begin(), touched_.end(), 0);
  for (const int row : nonzero)
    if (row < rest_dofs_) touched_[panel_of_[row]] = 1;
  const Eigen::Index columns = X.cols();
  for (std::size_t s = 0; s < panel_.size(); ++s) {
    if (!touched_[s]) continue;
    const Panel& p = panel_[s];
    using Values = Eigen::Map<const MatX, 0, Eigen::OuterStride<>>;
    const double* value = value_.data() + p.value;
    const Values top(value, p.width, p.width, Eigen::OuterStride<>(p.stride));
    auto own = X.middleRows(p.first, p.width);
    top.triangularView<Eigen::Lower>().solveInPlace(own);
    for (int j = 0; j < p.width; ++j) reached.push_back(p.first + j);
    const int below = p.height - p.width;
    if (below == 0) continue;
    const Values bottom(value + p.width, below, p.width, Eigen::OuterStride<>(p.stride));
    below_.resize(below, columns);
    below_.noalias() = bottom * own;
    const int* row = &row_[p.row + p.width];
    for (int i = 0; i < below; ++i)
      if (row[i] < rest_dofs_) touched_[panel_of_[row[i]]] = 1;
    for (Eigen::Index k = 0; k < columns; ++k)
      for (int i = 0; i < below; ++i) X(row[i], k) -= below_(i, k);
  }
}

std::size_t RestPanels::memory_bytes() const noexcept {
  return value_.size() * sizeof(double) + (triangle_.size() + unit_.size()) * sizeof(float) +
         other_.size() * sizeof(std::int16_t) + (row_.size() + panel_of_.size()) * sizeof(int) +
         panel_.size() * sizeof(Panel);
}

}  // namespace hapticd
