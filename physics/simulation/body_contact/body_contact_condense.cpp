// body_contact.h: elimination of the solved contacts from what is published. With A the rows that are closed
// (normals) or stick (tangents), D = mean diagonals, ε = 1e-9:
//
//   C'_pp    = C_pp − Yᵀ (A W Aᵀ + εD)⁻¹ Y,   Y = A H C_bp
//   x'_free  = x_free + C_pb Hᵀ λ + (C_pp − C'_pp) f
//
// So what is published feels the other bodies through the tissue and costs the haptic loop nothing; at f
// itself it is exact. Approximated between two steps: which contacts are closed, which stick, and the
// friction of those that slide do not change with the device, nor do the normals.
#include <Eigen/Cholesky>

#include "physics/simulation/body_contact/body_contact.h"

namespace hapticd {
namespace {

constexpr double relative_diagonal = 1e-9;

}  // namespace

void BodyContacts::patch_positions(PatchPositions& x) const {
  for (std::size_t i = 0; i < patch_.size(); ++i) {
    const Domain& d = domains_[patch_[i].body];
    x[i] = d.linear[d.place[patch_[i].node]];
  }
}

void BodyContacts::condense(CondensedProblem& problem) const {
  // Closed normals, sticking tangents: (contact, direction).
  std::vector<std::pair<int, int>> kept;
  for (int i = 0; i < static_cast<int>(solved_.size()); ++i) {
    const BodyContact& c = solved_[i];
    if (!(c.lambda[0] > 0)) continue;
    kept.emplace_back(i, 0);
    if (rows_per_contact_ == 1 || c.lambda.tail<2>().norm() > inside_the_cone * c.friction * c.lambda[0])
      continue;
    if (c.friction <= 0) continue;
    kept.emplace_back(i, 1);
    kept.emplace_back(i, 2);
  }
  const auto rows = static_cast<Eigen::Index>(kept.size());
  const auto nodes = static_cast<Eigen::Index>(patch_.size());
  problem.C().setZero();
  for (Eigen::Index j = 0; j < nodes; ++j)
    for (Eigen::Index i = 0; i < nodes; ++i) {
      if (patch_[i].body != patch_[j].body) continue;
      const Domain& d = domains_[patch_[i].body];
      problem.C().block<3, 3>(3 * i, 3 * j) =
          d.C.block<3, 3>(3 * d.place[patch_[i].node], 3 * d.place[patch_[j].node]);
    }

  MatX Y = MatX::Zero(rows, 3 * nodes);
  VecX f(3 * nodes), moved(3 * nodes);
  for (Eigen::Index j = 0; j < nodes; ++j) {
    const Domain& d = domains_[patch_[j].body];
    const int place = d.place[patch_[j].node];
    f.segment<3>(3 * j) = d.tool.segment<3>(3 * place);
    moved.segment<3>(3 * j) = d.C.middleRows<3>(3 * place) * d.force;
    for (Eigen::Index r = 0; r < rows; ++r) {
      const BodyContact& c = solved_[kept[r].first];
      for (const ContactStencil& l : c.stencil)
        if (l.place >= 0 && l.body == patch_[j].body)
          Y.block<1, 3>(r, 3 * j) +=
              l.weight * c.frame.col(kept[r].second).transpose() * d.C.block<3, 3>(3 * l.place, 3 * place);
    }
  }
  if (rows > 0 && nodes > 0) {
    const int m = rows_per_contact_;
    MatX M(rows, rows);
    VecX D(rows);
    for (Eigen::Index r = 0; r < rows; ++r) {
      for (Eigen::Index s = 0; s < rows; ++s)
        M(r, s) = W_(m * works_[kept[r].first] + kept[r].second, m * works_[kept[s].first] + kept[s].second);
      const int first = m * works_[kept[r].first];
      D[r] = m == 1 ? W_(first, first) : W_.block<3, 3>(first, first).trace() / 3;
    }
    Eigen::LLT<MatX> factor;
    for (double epsilon = relative_diagonal; epsilon < 1e-2; epsilon *= 100) {
      factor.compute(M + MatX((epsilon * D).asDiagonal()));
      if (factor.info() == Eigen::Success) break;
    }
    if (factor.info() == Eigen::Success) {
      factor.matrixL().solveInPlace(Y);
      problem.C().noalias() -= Y.transpose() * Y;
      const VecX Yf = Y * f;
      moved.noalias() += Y.transpose() * Yf;
    }
  }
  for (Eigen::Index j = 0; j < nodes; ++j) {
    const Domain& d = domains_[patch_[j].body];
    problem.x_free[j] = d.free[d.place[patch_[j].node]] + moved.segment<3>(3 * j);
  }
}

}  // namespace hapticd
