#include "physics/compliance/rest_panels.h"

#include <algorithm>

namespace hapticd {

namespace {

constexpr int lanes = 8;  // independent sums, so that the compiler may use vector registers

// y += P x for a column-major P (height × width, leading dimension ld), four columns at a time.
template <typename T>
void add_product(const T* P, int ld, int height, int width, const double* x, double* y) noexcept {
  int j = 0;
  for (; j + 4 <= width; j += 4) {
    const T *p0 = P + static_cast<std::ptrdiff_t>(j) * ld, *p1 = p0 + ld, *p2 = p1 + ld, *p3 = p2 + ld;
    const double x0 = x[j], x1 = x[j + 1], x2 = x[j + 2], x3 = x[j + 3];
    for (int i = 0; i < height; ++i)
      y[i] += static_cast<double>(p0[i]) * x0 + static_cast<double>(p1[i]) * x1 +
              static_cast<double>(p2[i]) * x2 + static_cast<double>(p3[i]) * x3;
  }
  for (; j < width; ++j) {
    const T* p = P + static_cast<std::ptrdiff_t>(j) * ld;
    for (int i = 0; i < height; ++i) y[i] += static_cast<double>(p[i]) * x[j];
  }
}

template <typename T>
double dot(const T* p, const double* x, int size) noexcept {
  double sum[lanes] = {};
  int i = 0;
  for (; i + lanes <= size; i += lanes)
    for (int l = 0; l < lanes; ++l) sum[l] += static_cast<double>(p[i + l]) * x[i + l];
  double total = 0;
  for (; i < size; ++i) total += static_cast<double>(p[i]) * x[i];
  for (const double s : sum) total += s;
  return total;
}

// x ← L⁻¹ x and x ← L⁻ᵀ x for a small lower triangle.
template <typename T>
void solve_lower(const T* L, int ld, int size, double* x) noexcept {
  for (int j = 0; j < size; ++j) {
    const T* l = L + static_cast<std::ptrdiff_t>(j) * ld;
    const double xj = x[j] /= static_cast<double>(l[j]);
    for (int i = j + 1; i < size; ++i) x[i] -= static_cast<double>(l[i]) * xj;
  }
}

template <typename T>
void solve_upper(const T* L, int ld, int size, double* x) noexcept {
  for (int j = size - 1; j >= 0; --j) {
    const T* l = L + static_cast<std::ptrdiff_t>(j) * ld;
    x[j] = (x[j] - dot(l + j + 1, x + j + 1, size - j - 1)) / static_cast<double>(l[j]);
  }
}

template <typename T, typename Panels>
void forward_with(const Panels& panels, const int* rows, const T* values, double* x, double* t) noexcept {
  for (const auto& p : panels) {
    const T* value = values + p.value;
    const int below = p.height - p.width;
    solve_lower(value, p.height, p.width, x + p.first);
    std::fill(t, t + below, 0.0);
    add_product(value + p.width, p.height, below, p.width, x + p.first, t);
    const int* row = rows + p.row + p.width;
    for (int i = 0; i < below; ++i) x[row[i]] -= t[i];
  }
}

template <typename T, typename Panels>
void backward_with(const Panels& panels, const int* rows, const T* values, double* x, double* t) noexcept {
  for (auto p = panels.rbegin(); p != panels.rend(); ++p) {
    const T* value = values + p->value;
    const int below = p->height - p->width;
    const int* row = rows + p->row + p->width;
    for (int i = 0; i < below; ++i) t[i] = x[row[i]];
    for (int j = 0; j < p->width; ++j)
      x[p->first + j] -= dot(value + static_cast<std::ptrdiff_t>(j) * p->height + p->width, t, below);
    solve_upper(value, p->height, p->width, x + p->first);
  }
}

}  // namespace

RestPanels::RestPanels(const cholmod_factor& L, int rest_dofs, bool rounded_copy) : rest_dofs_(rest_dofs) {
  const int* super = static_cast<const int*>(L.super);
  const int* row_start = static_cast<const int*>(L.pi);
  const int* value_start = static_cast<const int*>(L.px);
  const int* rows = static_cast<const int*>(L.s);
  const double* values = static_cast<const double*>(L.x);
  panel_of_.resize(rest_dofs);
  int tallest = 0;
  std::ptrdiff_t value_count = 0;
  for (int s = 0; s < static_cast<int>(L.nsuper) && super[s] < rest_dofs; ++s) {
    const int width = std::min(super[s + 1], rest_dofs) - super[s];
    const int height = row_start[s + 1] - row_start[s];
    std::fill_n(panel_of_.begin() + super[s], width, static_cast<int>(panel_.size()));
    panel_.push_back({super[s], width, height, static_cast<std::ptrdiff_t>(row_.size()), value_count});
    row_.insert(row_.end(), rows + row_start[s], rows + row_start[s + 1]);
    value_count += static_cast<std::ptrdiff_t>(width) * height;
    tallest = std::max(tallest, height);
  }
  value_.reserve(value_count);
  for (std::size_t s = 0; s < panel_.size(); ++s) {
    const Panel& p = panel_[s];
    const double* from = values + value_start[s];
    value_.insert(value_.end(), from, from + static_cast<std::ptrdiff_t>(p.width) * p.height);
  }
  if (rounded_copy) rounded_.assign(value_.begin(), value_.end());
  gathered_.resize(tallest);
  touched_.assign(panel_.size(), 0);
}

void RestPanels::forward(VecX& x, PanelPrecision precision) noexcept {
  if (precision == PanelPrecision::single && has_rounded_copy())
    forward_with(panel_, row_.data(), rounded_.data(), x.data(), gathered_.data());
  else
    forward_with(panel_, row_.data(), value_.data(), x.data(), gathered_.data());
}

void RestPanels::backward(VecX& x, PanelPrecision precision) noexcept {
  if (precision == PanelPrecision::single && has_rounded_copy())
    backward_with(panel_, row_.data(), rounded_.data(), x.data(), gathered_.data());
  else
    backward_with(panel_, row_.data(), value_.data(), x.data(), gathered_.data());
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
    const Values top(&value_[p.value], p.width, p.width, Eigen::OuterStride<>(p.height));
    auto own = X.middleRows(p.first, p.width);
    top.triangularView<Eigen::Lower>().solveInPlace(own);
    for (int j = 0; j < p.width; ++j) reached.push_back(p.first + j);
    const int below = p.height - p.width;
    if (below == 0) continue;
    const Values bottom(&value_[p.value + p.width], below, p.width, Eigen::OuterStride<>(p.height));
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
  return value_.size() * sizeof(double) + rounded_.size() * sizeof(float) +
         (row_.size() + panel_of_.size()) * sizeof(int) + panel_.size() * sizeof(Panel);
}

}  // namespace hapticd
