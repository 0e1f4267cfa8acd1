#include "tools/chart/solver/pgs_baseline.h"

#include <algorithm>
#include <cmath>

#include "physics/contact/solver/coulomb.h"

namespace hapticd {

double lcp_residual(const MatX& W, const VecX& q, const VecX& z) {
  const VecX w = W * z + q;
  double worst = 0, scale = 0;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    scale = std::max({scale, z[i], std::abs(q[i]) / W(i, i)});
    worst = std::max(worst, std::abs(std::min(z[i], w[i] / W(i, i))));
  }
  return worst > 0 ? worst / scale : 0;
}

PeerResult solve_projected(const MatX& W, const VecX& q, std::span<const double> mu, VecX& lambda,
                           double tolerance, int max_sweeps, const Deadline& deadline,
                           std::span<const double> limit) {
  constexpr int sweeps_between_checks = 4;
  const int width = mu.empty() ? 1 : 3;
  const auto row = [&](Eigen::Index i) { return lambda[i] - (W.col(i).dot(lambda) + q[i]) / W(i, i); };
  PeerResult result;
  while (result.sweeps < max_sweeps && !result.solved) {
    for (Eigen::Index i = 0; i < q.size(); i += width) {
      lambda[i] = std::max(0.0, row(i));
      if (width == 1) continue;
      if (!limit.empty()) lambda[i] = std::min(lambda[i], limit[static_cast<std::size_t>(i / 3)]);
      for (int t = 1; t <= 2; ++t) lambda[i + t] = row(i + t);
      const double disc = mu[static_cast<std::size_t>(i / 3)] * lambda[i],
                   length = lambda.segment<2>(i + 1).norm();
      if (length > disc) lambda.segment<2>(i + 1) *= disc / length;
    }
    const bool late = deadline.passed();
    if (++result.sweeps % sweeps_between_checks != 0 && !late) continue;
    result.residual = mu.empty() ? lcp_residual(W, q, lambda) : coulomb_residual(W, q, lambda, mu, limit);
    result.solved = result.residual <= tolerance;
    if (late) break;
  }
  return result;
}

}  // namespace hapticd
