#include "physics/compliance/zone/zone_factor.h"

#include <algorithm>

namespace hapticd {

void ZoneFactor::set_reference(ZoneReference& reference, int room) {
  reference_ = &reference;
  carried_.clear();
  corner_.reserve(static_cast<int>(corner_size()) + 3 * room);
  grow_corner();
}

bool ZoneFactor::carry(std::span<const int> nodes, const Eigen::Ref<const MatX>& V, TermSign sign) {
  places_.clear();
  for (const int n : nodes) places_.push_back(reference_->place(n));
  return carried_.change(reference_->panels(), V, places_, sign, reference_->outer_corner());
}

bool ZoneFactor::take_in(std::span<const int> nodes, std::span<const Mat3> rotation,
                         std::span<const std::uint8_t> gone) {
  if (nodes.empty()) return true;
  places_.clear();
  for (const int n : nodes) places_.push_back(reference_->place(n));
  const Eigen::Index before = corner_size();
  reference_->take_in(nodes);
  grow_corner();
  if (!carried_.tie(reference_->panels(), places_, before, reference_->outer_corner())) return false;
  reference_->take_in_elements(nodes, rotation, gone);
  return true;
}

bool ZoneFactor::factor_corner(const TissueState& state, std::span<const Mat3> Q,
                               std::span<const std::uint8_t> in_system, PartTimes* times) {
  const auto S_out = reference_->outer_corner();
  auto S = corner();
  for (Eigen::Index j = 0; j < S.cols(); ++j) {
    const Eigen::Index rows = S.rows() - j / row_multiple * row_multiple;  // whole tiles
    S.col(j).tail(rows) = S_out.col(j).tail(rows);
  }
  reference_->add_inside(state, Q, S);
  for (const int n : reference_->corner()) {
    if (in_system[n]) continue;
    const int p = 3 * reference_->zone_place(n);
    S.middleRows(p, 3).leftCols(p + 3).setZero();
    S.middleCols(p, 3).bottomRows(S.rows() - p).setZero();
    S.diagonal().segment<3>(p).setConstant(reference_->identity_scale());
  }
  const Within factor(times, StepPart::factor);
  return corner_.factor();
}

void ZoneFactor::forward(Half& half, Reach reach) {
  VecX& x = half.x;
  if (reach == Reach::all) reference_->panels().forward(x, precision_);
  if (reach == Reach::last_panel) reference_->panels().forward_last(x, precision_);
  auto tail = corner_of(x);
  Eigen::Map<MatX> column(x.data(), x.size(), 1);
  if (reach == Reach::corner || carried_.empty())
    half.g.setZero(carried_.columns(), 1);
  else
    carried_.before_corner(column, half.g, column.middleRows(rest_dofs(), tail.size()));
  corner().triangularView<Eigen::Lower>().solveInPlace(tail);
}

void ZoneFactor::through_corner(Half& half) {
  VecX& x = half.x;
  auto tail = corner_of(x);
  Eigen::Map<MatX> column(x.data(), x.size(), 1);
  corner().triangularView<Eigen::Lower>().transpose().solveInPlace(tail);
  if (!carried_.empty()) carried_.after_corner(column.middleRows(rest_dofs(), tail.size()), half.g, column);
}

void ZoneFactor::backward(Half& half) {
  through_corner(half);
  reference_->panels().backward(half.x, precision_);
}

void ZoneFactor::backward_near(Half& half) {
  through_corner(half);
  reference_->panels().backward_last(half.x, precision_);
}

void ZoneFactor::solve_corner(Eigen::Ref<VecX> force) {
  corner().triangularView<Eigen::Lower>().solveInPlace(force);
  corner().triangularView<Eigen::Lower>().transpose().solveInPlace(force);
}

void ZoneFactor::patch(std::span<const int> places, Eigen::Ref<MatX> block) {
  const int rest = static_cast<int>(rest_dofs() / 3);
  zone_places_.clear();
  std::vector<int> outside;  // indices into places
  std::vector<int> rows;     // theirs
  for (std::size_t i = 0; i < places.size(); ++i) {
    zone_places_.push_back(std::max(-1, places[i] - rest));
    if (places[i] < 0 || places[i] >= rest) continue;
    outside.push_back(static_cast<int>(i));
    for (int r = 0; r < 3; ++r) rows.push_back(3 * places[i] + r);
  }
  patch_inverse_(corner(), zone_places_, block);  // rows and columns of those outside stay zero
  if (!outside.empty()) patch_beyond_zone(outside, rows, block);
}

// With f the first half of a solve for a unit force,  C_uu = f_uᵀ f_u over rest, λ and corner,
// C_cu = rows c of S⁻¹ (f_u before the corner).
void ZoneFactor::patch_beyond_zone(std::span<const int> outside, std::span<const int> rows,
                                   Eigen::Ref<MatX> block) {
  const auto columns = static_cast<Eigen::Index>(rows.size());
  const Eigen::Index height = rest_dofs() + corner_size();
  if (beyond_.rows() < height || beyond_.cols() < columns)
    beyond_.setZero(std::max(beyond_.rows(), height + height / 8), std::max(beyond_.cols(), 2 * columns));
  auto X = beyond_.topLeftCorner(height, columns);
  for (std::size_t k = 0; k < rows.size(); ++k) X(rows[k], static_cast<Eigen::Index>(k)) = 1;
  std::vector<int> reached;
  reference_->panels().forward_sparse(X, rows, reached);
  const MatX X_r = X(reached, Eigen::all);
  MatX C_uu = X_r.transpose() * X_r;
  auto tail = X.middleRows(rest_dofs(), corner_size());
  if (!carried_.empty()) {
    carried_.before_corner(X, g_, tail);
    carried_.add_energy(g_, C_uu);
  }
  corner().triangularView<Eigen::Lower>().solveInPlace(tail);
  C_uu.noalias() += tail.transpose() * tail;
  corner().triangularView<Eigen::Lower>().transpose().solveInPlace(tail);
  for (std::size_t u = 0; u < outside.size(); ++u) {
    const int at = 3 * outside[u];
    for (std::size_t w = 0; w < outside.size(); ++w)
      block.block<3, 3>(3 * outside[w], at) = C_uu.block<3, 3>(3 * w, 3 * u);
    for (std::size_t c = 0; c < zone_places_.size(); ++c) {
      if (zone_places_[c] < 0) continue;
      const Mat3 entry = tail.block<3, 3>(3 * zone_places_[c], 3 * u);
      block.block<3, 3>(3 * c, at) = entry;
      block.block<3, 3>(at, 3 * c) = entry.transpose();
    }
  }
  for (Eigen::Index k = 0; k < columns; ++k)
    for (const int row : reached) X(row, k) = 0;
  tail.setZero();
}

std::size_t ZoneFactor::memory_bytes() const noexcept {
  return reference_->panels().memory_bytes() + carried_.memory_bytes() +
         2 * sizeof(double) * static_cast<std::size_t>(corner_size() * corner_size());
}

}  // namespace hapticd
