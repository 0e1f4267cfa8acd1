#include "physics/compliance/zone/far_field_updates.h"

#include <algorithm>

namespace hapticd {

void FarFieldUpdates::clear() {
  terms_.clear();
  columns_ = 0;
}

Eigen::Ref<MatX> FarFieldUpdates::scratch(const LeadingColumns& panels, Eigen::Index rank,
                                          Eigen::Index corner) {
  const Eigen::Index rows = panels.rest_dofs() + corner;
  if (X_.rows() < rows || X_.cols() < rank)  // seldom: its pages are cleared
    X_.setZero(std::max(X_.rows(), rows + rows / 8), std::max(X_.cols(), 2 * rank));
  return X_.topLeftCorner(rows, rank);
}

bool FarFieldUpdates::change(LeadingColumns& panels, const Eigen::Ref<const MatX>& V,
                             std::span<const int> places, TermSign sign, Corner S_out) {
  if (V.cols() == 0) return true;
  auto X = scratch(panels, V.cols(), S_out.rows());
  std::vector<int> nonzero;
  for (int c = 0; c < static_cast<int>(places.size()); ++c)
    for (int r = 0; r < 3; ++r) {
      nonzero.push_back(3 * places[c] + r);
      X.row(nonzero.back()) = V.row(3 * c + r);
    }
  return eliminate(panels, X, nonzero, sign == TermSign::take_out ? 1.0 : -1.0, S_out);
}

bool FarFieldUpdates::tie(LeadingColumns& panels, std::span<const int> places, Eigen::Index row,
                          Corner S_out) {
  if (places.empty()) return true;
  auto X = scratch(panels, static_cast<Eigen::Index>(3 * places.size()), S_out.rows());
  std::vector<int> nonzero;
  for (const int p : places)
    for (int r = 0; r < 3; ++r) {
      const auto k = static_cast<Eigen::Index>(nonzero.size());
      nonzero.push_back(3 * p + r);
      X(nonzero.back(), k) = 1;
      X(panels.rest_dofs() + row + k, k) = -1;
    }
  return eliminate(panels, X, nonzero, 0, S_out);
}

bool FarFieldUpdates::eliminate(LeadingColumns& panels, Eigen::Ref<MatX> X, std::span<const int> nonzero,
                                double D0, Corner S_out) {
  const Eigen::Index rank = X.cols();
  const int rest = panels.rest_dofs();
  Term next;
  next.first = columns_;
  panels.forward_sparse(X, nonzero, next.row);
  next.Y = X(next.row, Eigen::all);
  next.v = X.middleRows(rest, S_out.rows());
  MatX D = -next.Y.transpose() * next.Y;
  D.diagonal().array() += D0;
  next.W.resize(columns_, rank);
  MatX t(columns_, rank);  // t_ij of all earlier i, stacked; t_kiᵀ D_k⁻¹ t_kj = W_kiᵀ t_kj
  for (const Term& earlier : terms_) {
    const Eigen::Index width = earlier.Y.cols();
    auto own = t.middleRows(earlier.first, width);
    own.noalias() = -earlier.Y.transpose() * X(earlier.row, Eigen::all);
    own.noalias() -= earlier.W.transpose() * t.topRows(earlier.first);
    next.W.middleRows(earlier.first, width) = solved(earlier, own);
    next.v.topRows(earlier.v.rows()).noalias() -= earlier.v * next.W.middleRows(earlier.first, width);
  }
  D.noalias() -= t.transpose() * next.W;

  for (const int row : next.row) X.row(row).setZero();
  X.middleRows(rest, S_out.rows()).setZero();

  next.sign = D0 > 0 ? 1.0 : -1.0;
  next.D.compute(next.sign * D);
  if (next.D.info() != Eigen::Success || !next.v.allFinite()) return false;
  const MatX half = next.D.matrixL().solve(MatX(next.v.transpose()));
  S_out.selfadjointView<Eigen::Lower>().rankUpdate(half.transpose(), -next.sign);
  columns_ += static_cast<int>(rank);
  terms_.push_back(std::move(next));
  return true;
}

void FarFieldUpdates::before_corner(const Eigen::Ref<const MatX>& X, MatX& g, Eigen::Ref<MatX> corner) const {
  g.resize(columns_, X.cols());
  for (const Term& term : terms_) {
    const Eigen::Index rank = term.Y.cols();
    auto own = g.middleRows(term.first, rank);
    own.noalias() = -term.Y.transpose() * X(term.row, Eigen::all);
    own.noalias() -= term.W.transpose() * g.topRows(term.first);
    corner.topRows(term.v.rows()).noalias() -= term.v * solved(term, own);
  }
}

void FarFieldUpdates::after_corner(const Eigen::Ref<const MatX>& corner, MatX& g, Eigen::Ref<MatX> X) const {
  for (const Term& term : terms_) {
    auto own = g.middleRows(term.first, term.Y.cols());
    own.noalias() -= term.v.transpose() * corner.topRows(term.v.rows());
    own = solved(term, own);
  }
  for (auto term = terms_.rbegin(); term != terms_.rend(); ++term) {
    const auto own = g.middleRows(term->first, term->Y.cols());
    g.topRows(term->first).noalias() -= term->W * own;
    const MatX change = term->Y * own;
    for (Eigen::Index k = 0; k < X.cols(); ++k)
      for (std::size_t i = 0; i < term->row.size(); ++i) X(term->row[i], k) -= change(i, k);
  }
}

void FarFieldUpdates::add_energy(const MatX& g, MatX& C) const {
  for (const Term& term : terms_) {
    const auto own = g.middleRows(term.first, term.Y.cols());
    C.noalias() += own.transpose() * solved(term, own);
  }
}

std::size_t FarFieldUpdates::memory_bytes() const noexcept {
  std::size_t bytes = 0;
  for (const Term& t : terms_)
    bytes += t.row.size() * sizeof(int) +
             sizeof(double) * static_cast<std::size_t>(t.Y.size() + t.v.size() + t.W.size());
  return bytes;
}

}  // namespace hapticd
