#include "physics/compliance/multifrontal_factor.h"

#include <algorithm>
#include <stdexcept>

namespace hapticd {

namespace {

// Runs are short: the compiler's check for overlap would cost as much as the sum.
inline void add(const double* __restrict from, double* __restrict to, int count) noexcept {
  for (int r = 0; r < count; ++r) to[r] += from[r];
}

}  // namespace

void MultifrontalFactor::set_order(const SystemMatrix& matrix, std::span<const int> order,
                                   std::span<const std::uint8_t> live_edges, int zone) {
  plan_ = plan_fronts(matrix, order, live_edges, zone);
  values_.reserve(plan_.values);
  workspace_.reserve(plan_.workspace);
  reciprocal_.resize(3 * plan_.order.size());
  gathered_.resize(plan_.tallest);
  x_.setZero(static_cast<Eigen::Index>(3 * plan_.order.size()));
}

void MultifrontalFactor::assemble(const SystemMatrix& matrix, std::size_t s) noexcept {
  const FrontPlan::Front& front = plan_.fronts[s];
  double* panel = values_.data() + front.panel;
  std::fill_n(panel, front.stride * front.width, 0.0);
  for (int k = 0; k < front.width; k += 3) {
    const Mat3& block = matrix.diagonal()[plan_.order[(front.first + k) / 3]];
    for (int c = 0; c < 3; ++c)
      for (int r = c; r < 3; ++r) panel[(k + c) * front.stride + k + r] = block(r, c);
  }
  for (int k = s > 0 ? plan_.fronts[s - 1].couplings_end : 0; k < front.couplings_end; ++k) {
    const FrontPlan::Coupling& coupling = plan_.couplings[k];
    const Mat3& block = matrix.coupling()[coupling.edge];
    double* to = values_.data() + coupling.to;
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) to[c * front.stride + r] = coupling.transposed ? block(c, r) : block(r, c);
  }
}

void MultifrontalFactor::add_child(const FrontPlan::Front& front, int child) noexcept {
  const FrontPlan::Front& from = plan_.fronts[child];
  const FrontPlan::Run* runs = plan_.runs.data() + (child > 0 ? plan_.fronts[child - 1].runs_end : 0);
  const FrontPlan::Run* end = plan_.runs.data() + from.runs_end;
  // Both by the rows of their fronts' panels.
  const double* square = workspace_.data() + from.square - square_origin(from.width) + from.width;
  double* panel = values_.data() + front.panel;
  double* own_square = workspace_.data() + front.square - square_origin(front.width);
  for (const FrontPlan::Run* of_column = runs; of_column != end; ++of_column)
    for (int c = 0; c < of_column->count; ++c) {
      const double* source = square + (of_column->from + c) * from.square_stride;
      const int column = of_column->to + c;
      double* target = column < front.width ? panel + column * front.stride
                                            : own_square + (column - front.width) * front.square_stride;
      add(source + of_column->from + c, target + of_column->to + c, of_column->count - c);
      for (const FrontPlan::Run* run = of_column + 1; run != end; ++run)
        add(source + run->from, target + run->to, run->count);
    }
}

void MultifrontalFactor::factor(const SystemMatrix& matrix) {
  bool positive = true;
  int child = 0;
  for (std::size_t s = 0; positive && s < plan_.fronts.size(); ++s) {
    const FrontPlan::Front& front = plan_.fronts[s];
    const int below = front.size - front.width;
    double* panel = values_.data() + front.panel;
    double* square = workspace_.data() + front.square;
    const bool leaf = child == front.children_end;
    assemble(matrix, s);
    if (!leaf) std::fill_n(square, front.square_stride * below, 0.0);
    for (; child < front.children_end; ++child) add_child(front, plan_.children[child]);
    positive = kernels_->factor_panel(panel, front.stride, front.height, front.width,
                                      reciprocal_.data() + front.first);
    if (positive && below > 0)
      kernels_->subtract_square(panel, front.stride, front.height, front.width, front.size, square,
                                front.square_stride, leaf);
  }
  if (positive && x_.size() > 0) {
    const auto [least, largest] = std::minmax_element(reciprocal_.data(), reciprocal_.data() + x_.size());
    positive = *least * *least > 1e-15 * (*largest * *largest);
  }
  if (!positive)
    throw std::runtime_error(
        "the system matrix A is not positive definite: a body (or a part cut from it) "
        "has neither mass nor support");
}

void MultifrontalFactor::trailing_corner(int nodes, MatX& corner) const {
  const int size = 3 * nodes;
  const int first = static_cast<int>(x_.size()) - size;
  corner.setZero(size, size);
  for (auto front = plan_.fronts.rbegin(); front != plan_.fronts.rend(); ++front) {
    if (front->first + front->width <= first) break;
    for (int k = std::max(0, first - front->first); k < front->width; ++k) {
      const double* column = values_.data() + front->panel + k * front->stride;
      const int j = front->first + k - first;
      for (int i = k; i < front->width; ++i) corner(front->first + i - first, j) = column[i];
      for (int i = front->width; i < front->size; ++i)
        corner(plan_.below[front->below + i - front->width] - first, j) = column[i];
    }
  }
}

std::size_t MultifrontalFactor::memory_bytes() const noexcept {
  return static_cast<std::size_t>(plan_.values + plan_.workspace) * sizeof(double) +
         (plan_.below.size() + plan_.children.size() + 2 * plan_.order.size()) * sizeof(int) +
         plan_.fronts.size() * sizeof(FrontPlan::Front) + plan_.runs.size() * sizeof(FrontPlan::Run) +
         plan_.couplings.size() * sizeof(FrontPlan::Coupling);
}

}  // namespace hapticd
