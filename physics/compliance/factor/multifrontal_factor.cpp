#include "physics/compliance/factor/multifrontal_factor.h"

#include <algorithm>
#include <stdexcept>

namespace hapticd {

namespace {

// With some to spare, for the order of the next zone.
void reserve(PageMemory& memory, std::ptrdiff_t numbers) {
  if (memory.data() && static_cast<std::size_t>(numbers) <= memory.size()) return;
  memory.reserve(static_cast<std::size_t>(numbers + numbers / 16));
}

}  // namespace

void MultifrontalFactor::set_order(const SystemMatrix& matrix, std::span<const int> order,
                                   std::span<const std::uint8_t> live_edges, int zone,
                                   ZoneFronts zone_fronts) {
  plan_ = plan_fronts(matrix, order, live_edges, zone, zone_fronts);
  reserve(values_, plan_.values);
  reserve(workspace_, plan_.workspace + row_multiple);  // what add_child reads behind the last column
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
  const FrontPlan::Coupling* coupling =
      plan_.couplings.data() + (s > 0 ? plan_.fronts[s - 1].couplings_end : 0);
  const FrontPlan::Coupling* end = plan_.couplings.data() + front.couplings_end;
  constexpr int ahead = 8;
  for (; coupling != end; ++coupling) {
    if (end - coupling > ahead) __builtin_prefetch(matrix.coupling()[coupling[ahead].edge].data());
    const double* block = matrix.coupling()[coupling->edge].data();
    const int of_row = coupling->transposed ? 3 : 1;
    const int of_column = 4 - of_row;
    double* to = values_.data() + coupling->to;
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) to[c * front.stride + r] = block[r * of_row + c * of_column];
  }
}

// Columns `begin` to `end` of the parent, by its own rows.
void MultifrontalFactor::add_child(int child, int begin, int end, double* target,
                                   std::ptrdiff_t stride) noexcept {
  const FrontPlan::Front& from = plan_.fronts[child];
  const double* contribution =
      workspace_.data() + from.contribution - contribution_origin(from.width) + from.width;
  const FrontChunk* chunks = plan_.chunks.data();
  kernels_->add_child(contribution, from.contribution_stride,
                      chunks + (child > 0 ? plan_.fronts[child - 1].chunks_end : 0), chunks + from.chunks_end,
                      begin, end, target, stride);
}

// kept: unknowns of the last front that are not eliminated.
bool MultifrontalFactor::eliminate(const SystemMatrix& matrix, int kept) {
  bool positive = true;
  int child = 0;
  FrontAhead ahead;
  for (std::size_t s = 0; positive && s < plan_.fronts.size(); ++s) {
    const FrontPlan::Front& front = plan_.fronts[s];
    double* panel = values_.data() + front.panel;
    double* contribution = workspace_.data() + front.contribution;
    assemble(matrix, s);
    for (int c = child; c < front.children_end; ++c)
      add_child(plan_.children[c], 0, front.width, panel, front.stride);
    ahead.move(panel + front.stride * front.width, values_.data() + plan_.values);
    const int width = s + 1 < plan_.fronts.size() ? front.width : front.width - kept;
    positive = width == 0 || kernels_->factor_panel(panel, front.stride, front.height, width,
                                                    reciprocal_.data() + front.first, ahead);
    if (positive && front.size > front.width) {
      kernels_->make_contribution(panel, front.stride, front.height, front.width, front.size, contribution,
                                  front.contribution_stride, ahead);
      double* by_row =
          contribution - contribution_origin(front.width) - front.width * front.contribution_stride;
      for (int c = child; c < front.children_end; ++c)
        add_child(plan_.children[c], front.width, front.size, by_row, front.contribution_stride);
    }
    child = front.children_end;
  }
  const auto eliminated = x_.size() - kept;
  if (positive && eliminated > 0) {
    const auto [least, largest] = std::minmax_element(reciprocal_.data(), reciprocal_.data() + eliminated);
    positive = *least * *least > 1e-15 * (*largest * *largest);
  }
  return positive;
}

void MultifrontalFactor::factor(const SystemMatrix& matrix) {
  if (!eliminate(matrix, 0))
    throw std::runtime_error(
        "the system matrix A is not positive definite: a body (or a part cut from it) "
        "has neither mass nor support");
}

void MultifrontalFactor::condense(const SystemMatrix& matrix, int nodes, MatX& S) {
  kept_ = 3 * nodes;
  if (!eliminate(matrix, kept_)) throw std::runtime_error("what is to be condensed has no support");
  const FrontPlan::Front& last = plan_.fronts.back();
  const int own = last.width - kept_;
  const Eigen::Map<const MatX, 0, Eigen::OuterStride<>> panel(values_.data() + last.panel, last.width,
                                                              last.width, Eigen::OuterStride<>(last.stride));
  S = panel.bottomRightCorner(kept_, kept_).selfadjointView<Eigen::Lower>();
  if (own > 0) {
    const MatX L = panel.bottomLeftCorner(kept_, own);
    S.noalias() -= L * L.transpose();
  }
  gathered_.resize(std::max<std::size_t>(gathered_.size(), static_cast<std::size_t>(kept_)));
}

void MultifrontalFactor::trailing_corner(int nodes, MatX& corner) const {
  const int size = 3 * nodes;
  const int first = static_cast<int>(x_.size()) - size;
  corner.resize(size, size);
  for (auto front = plan_.fronts.rbegin(); front != plan_.fronts.rend(); ++front) {
    if (front->first + front->width <= first) break;
    for (int k = std::max(0, first - front->first); k < front->width; ++k) {
      const double* column = values_.data() + front->panel + k * front->stride;
      const int j = front->first + k - first;
      double* to = corner.col(j).data();
      std::fill_n(to, j, 0.0);
      double* below = std::copy(column + k, column + front->width, to + j);
      std::fill(below, to + size, 0.0);
      for (int i = front->width; i < front->size; ++i)
        corner(plan_.below[front->below + i - front->width] - first, j) = column[i];
    }
  }
}

std::vector<int> MultifrontalFactor::corner_pieces(int nodes) const {
  const int first = static_cast<int>(x_.size()) - 3 * nodes;
  std::vector<int> pieces;
  for (const FrontPlan::Front& front : plan_.fronts)
    if (front.first + front.width > first) pieces.push_back(std::max(0, front.first - first) / 3);
  return pieces;
}

std::size_t MultifrontalFactor::memory_bytes() const noexcept {
  return static_cast<std::size_t>(plan_.values + plan_.workspace) * sizeof(double) +
         (plan_.below.size() + plan_.children.size() + 2 * plan_.order.size()) * sizeof(int) +
         plan_.fronts.size() * sizeof(FrontPlan::Front) + plan_.chunks.size() * sizeof(FrontChunk) +
         plan_.couplings.size() * sizeof(FrontPlan::Coupling);
}

}  // namespace hapticd
