#include "physics/compliance/zone/leading_columns.h"

#include <algorithm>

#include "physics/compliance/factor/forward_panel.h"
#include "physics/compliance/factor/panel_kernels.h"

namespace hapticd {

LeadingColumns::LeadingColumns(MultifrontalFactor&& factor, int rest_dofs, bool quantised_copy,
                               PageMemory quantised_memory)
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
  if (quantised_copy)
    rounded_ = QuantisedFactor(panel_, row_.data(), value_.data(), std::move(quantised_memory));
  gathered_.resize(tallest);
  touched_.assign(panel_.size(), 0);
}

void LeadingColumns::forward(VecX& x, PanelPrecision precision) noexcept {
  if (solves_rounded(precision)) return rounded_.forward(x);
  for (const LeadingPanel& p : panel_) forward_full(p, x);
}

void LeadingColumns::backward(VecX& x, PanelPrecision precision) noexcept {
  if (solves_rounded(precision)) return rounded_.backward(x);
  for (auto p = panel_.rbegin(); p != panel_.rend(); ++p) backward_full(*p, x);
}

void LeadingColumns::forward_last(VecX& x, PanelPrecision precision) noexcept {
  if (solves_rounded(precision)) return rounded_.forward_last(x);
  if (!panel_.empty()) forward_full(panel_.back(), x);
}

void LeadingColumns::backward_last(VecX& x, PanelPrecision precision) noexcept {
  if (solves_rounded(precision)) return rounded_.backward_last(x);
  if (!panel_.empty()) backward_full(panel_.back(), x);
}

void LeadingColumns::forward_full(const LeadingPanel& p, VecX& x) noexcept {
  double* t = gathered_.data();
  const double* value = value_.data() + p.value;
  const int below = p.height - p.width;
  panels::solve_lower(value, p.stride, p.width, &x[p.first]);
  std::fill(t, t + below, 0.0);
  panels::add_product(value + p.width, p.stride, below, p.width, &x[p.first], t);
  const int* row = &row_[p.row + p.width];
  for (int i = 0; i < below; ++i) x[row[i]] -= t[i];
}

void LeadingColumns::backward_full(const LeadingPanel& p, VecX& x) noexcept {
  double* t = gathered_.data();
  const double* value = value_.data() + p.value;
  const int below = p.height - p.width;
  const int* row = &row_[p.row + p.width];
  for (int i = 0; i < below; ++i) t[i] = x[row[i]];
  panels::subtract_transposed(value + p.width, p.stride, below, p.width, t, &x[p.first]);
  panels::solve_upper(value, p.stride, p.width, &x[p.first]);
}

void LeadingColumns::forward_sparse(Eigen::Ref<MatX> X, std::span<const int> nonzero,
                                    std::vector<int>& reached) {
  reached.clear();
  std::fill(touched_.begin(), touched_.end(), 0);
  for (const int row : nonzero)
    if (row < rest_dofs_) touched_[panel_of_[row]] = 1;
  const Eigen::Index columns = X.cols();
  for (std::size_t s = 0; s < panel_.size(); ++s) {
    if (!touched_[s]) continue;
    const LeadingPanel& p = panel_[s];
    forward_panel(value_.data() + p.value, p.stride, p.width, p.height, X.middleRows(p.first, p.width),
                  below_);
    for (int j = 0; j < p.width; ++j) reached.push_back(p.first + j);
    const int below = p.height - p.width;
    if (below == 0) continue;
    const int* row = &row_[p.row + p.width];
    for (int i = 0; i < below; ++i)
      if (row[i] < rest_dofs_) touched_[panel_of_[row[i]]] = 1;
    for (Eigen::Index k = 0; k < columns; ++k)
      for (int i = 0; i < below; ++i) X(row[i], k) -= below_(i, k);
  }
}

std::size_t LeadingColumns::memory_bytes() const noexcept {
  return value_.size() * sizeof(double) + rounded_.memory_bytes() +
         (row_.size() + panel_of_.size()) * sizeof(int) + panel_.size() * sizeof(LeadingPanel);
}

}  // namespace hapticd
