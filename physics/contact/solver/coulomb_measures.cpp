#include "physics/contact/solver/coulomb_measures.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hapticd {

double mean_diagonal(const Eigen::Ref<const MatX>& W, int i) noexcept {
  return (W(3 * i, 3 * i) + W(3 * i + 1, 3 * i + 1) + W(3 * i + 2, 3 * i + 2)) / 3;
}

double inverse_or_zero(double d) noexcept { return d > std::numeric_limits<double>::min() ? 1 / d : 0; }

double natural_map(const double* delta, const double* lambda, std::span<const double> rho,
                   std::span<const double> mu, std::span<const double> limit, double& scale) noexcept {
  double worst = 0;
  for (std::size_t i = 0; i < mu.size(); ++i) {
    const Eigen::Map<const Vec3> l(lambda + 3 * i), d(delta + 3 * i);
    if (d[0] >= 0 && l.isZero(0)) continue;
    Vec3 v = l - rho[i] * d;
    v[0] -= rho[i] * mu[i] * d.tail<2>().norm();
    const double off = (l - project_on_cone(v, mu[i], limit_at(limit, i))).squaredNorm();
    if (std::isnan(off)) return off;
    worst = std::max(worst, off);
    scale = std::max(scale, l.squaredNorm());
  }
  return worst;
}

double free_scale(const Eigen::Ref<const VecX>& q, std::span<const double> rho,
                  std::span<const double> limit) noexcept {
  double scale = 0;
  for (std::size_t i = 0; i < rho.size(); ++i) {
    const double most = limit_at(limit, i);
    const double free = rho[i] * rho[i] * q.segment<3>(static_cast<Eigen::Index>(3 * i)).squaredNorm();
    scale = std::max(scale, std::min(free, most * most));
  }
  return scale;
}

// Forces whose squares are beyond all numbers solve nothing.
double relative_residual(double worst, double scale) noexcept {
  if (!std::isfinite(scale)) return std::numeric_limits<double>::infinity();
  return worst == 0 ? 0 : std::sqrt(worst / scale);
}

double alart_curnier(const CoulombSystem& s, const double* lambda, const double* delta) noexcept {
  double sum = 0;
  for (int i = 0; i < s.contacts; ++i) {
    const Eigen::Map<const Vec3> l(lambda + 3 * i), d(delta + 3 * i);
    if (d[0] >= 0 && l.isZero(0)) continue;
    Vec3 y = l - s.stretch * s.rho[i] * d;
    y[0] = std::min(std::max(0.0, y[0]), s.limit_of(i));
    const double pulled = y.tail<2>().squaredNorm(), disc = s.mu[i] * y[0];
    if (pulled > disc * disc) y.tail<2>() *= disc / std::sqrt(pulled);
    sum += (l - y).squaredNorm();
  }
  return 0.5 * sum;
}

Vec3 into_cone(const Vec3& l, double mu, double limit) noexcept {
  if (!(l[0] > 0)) return Vec3::Zero();
  const double t = l.tail<2>().norm(), scale = t > mu * l[0] ? mu * l[0] / t : 1;
  return {std::min(l[0], limit), scale * l[1], scale * l[2]};
}

}  // namespace hapticd
