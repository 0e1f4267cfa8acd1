#include "physics/simulation/body_contact/frictionless_elimination.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <vector>

namespace hapticd {
namespace {

constexpr double epsilon = 1e-9;        // of W_ii, as lcp.h
constexpr int patience = 4;             // changes in vain
constexpr double good_residual = 1e-8;  // as CoulombOptions

MatX rows_and_columns(const MatX& W, std::span<const int> of) {
  const auto n = static_cast<Eigen::Index>(of.size());
  MatX out(n, n);
  for (Eigen::Index j = 0; j < n; ++j) {
    for (Eigen::Index i = 0; i < n; ++i) out(i, j) = W(of[i], of[j]);
    out(j, j) += epsilon * W(of[j], of[j]);
  }
  return out;
}

}  // namespace

EliminationResult solve_eliminated(const MatX& W_bb, const VecX& q_b, VecX& lambda_b, const MatX& W_tb,
                                   const MatX& W_tt, const VecX& q_t, std::span<const double> mu,
                                   std::span<const double> limit, VecX& lambda_t, LcpWorkspace& lcp,
                                   CoulombWorkspace& coulomb, const CoulombOptions& options) {
  const Eigen::Index nb = q_b.size(), nt = q_t.size();
  std::vector<std::uint8_t> closed(nb);
  for (Eigen::Index i = 0; i < nb; ++i) closed[i] = lambda_b[i] > 0;
  VecX b = lambda_b, t = lambda_t;
  double of_bodies = 0, of_tool = 0;
  const auto solve_bodies = [&] {
    if (nb == 0) return true;
    const VecX q = q_b + W_tb.transpose() * t;
    const LcpResult r = solve_lcp(W_bb, q, b, closed, lcp, 0, LcpOptions{});
    of_bodies = r.residual;
    return r.status == SolveStatus::solved;
  };
  if (!solve_bodies()) return {};
  Eigen::Index fewest = nb + 1;
  for (int vain = 0; nt > 0;) {
    std::vector<int> A;
    for (Eigen::Index i = 0; i < nb; ++i)
      if (closed[i]) A.push_back(static_cast<int>(i));
    const auto a = static_cast<Eigen::Index>(A.size());
    // Y = L⁻¹ [W_At q_A], with L Lᵀ = W_AA + ε D.
    MatX Y(a, nt + 1);
    for (Eigen::Index i = 0; i < a; ++i) {
      Y.row(i).head(nt) = W_tb.col(A[i]).transpose();
      Y(i, nt) = q_b[A[i]];
    }
    if (a > 0) {
      const Eigen::LLT<MatX> factor(rows_and_columns(W_bb, A));
      if (factor.info() != Eigen::Success) return {};
      factor.matrixL().solveInPlace(Y);
    }
    MatX W = W_tt;
    VecX q = q_t;
    W.noalias() -= Y.leftCols(nt).transpose() * Y.leftCols(nt);
    q.noalias() -= Y.leftCols(nt).transpose() * Y.col(nt);
    solve_coulomb(W, q, mu, t, coulomb, 0, options, limit);
    of_tool = coulomb_residual(W, q, t, mu, limit);  // of W itself, whatever diagonal was raised
    if (!(of_tool <= good_residual) || !t.allFinite()) return {};
    const std::vector<std::uint8_t> before = closed;
    if (!solve_bodies()) return {};
    Eigen::Index changed = 0;
    for (Eigen::Index i = 0; i < nb; ++i) changed += closed[i] != before[i];
    if (changed == 0) break;
    vain = changed < fewest ? 0 : vain + 1;
    fewest = std::min(fewest, changed);
    if (vain == patience) return {};
  }
  lambda_b = b;
  lambda_t = t;
  return {true, std::max(of_bodies, of_tool)};
}

}  // namespace hapticd
