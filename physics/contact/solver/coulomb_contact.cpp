#include <algorithm>
#include <cmath>
#include <limits>

#include "physics/contact/solver/coulomb.h"

namespace hapticd {
namespace {

constexpr int max_root_steps = 80;  // bisection alone would need about 60

}  // namespace

CoulombContact::CoulombContact(const Mat3& A, double mu, double limit) noexcept
    : a_nn_(A(0, 0)), mu_(mu), limit_(limit) {
  if (!(a_nn_ > 0)) return;
  const Eigen::Vector2d a_tn = A.block<2, 1>(1, 0);
  to_n_ = a_tn / a_nn_;
  if (mu_ <= 0) return;
  const Eigen::Matrix2d S = A.bottomRightCorner<2, 2>() - to_n_ * a_tn.transpose();
  const double mean = 0.5 * (S(0, 0) + S(1, 1)), half = 0.5 * (S(0, 0) - S(1, 1));
  const double off = 0.5 * (S(0, 1) + S(1, 0));
  const double radius = std::hypot(half, off), least = std::numeric_limits<double>::epsilon() * a_nn_;
  eigenvalue_ = {std::max(mean + radius, least), std::max(mean - radius, least)};
  // Half of the angle atan2(off, half), without trigonometry.
  double c = 1, s = 0;
  if (radius > 0) {
    const double larger = std::sqrt(0.5 * (1 + std::abs(half) / radius)),
                 smaller = 0.5 * off / (radius * larger);
    c = half >= 0 ? larger : std::abs(smaller);
    s = half >= 0 ? smaller : std::copysign(larger, off);
  }
  basis_ << c, -s, s, c;

  // A⁻¹ through S: λ_t = −S⁻¹(b_t − a b_n), λ_n = −b_n/A_nn − a·λ_t, a = A_tn/A_nn.
  const Eigen::Matrix2d S_inv = basis_ * eigenvalue_.cwiseInverse().asDiagonal() * basis_.transpose();
  inverse_.bottomRightCorner<2, 2>() = S_inv;
  inverse_.block<2, 1>(1, 0) = -S_inv * to_n_;
  inverse_.block<1, 2>(0, 1) = inverse_.block<2, 1>(1, 0).transpose();
  inverse_(0, 0) = 1 / a_nn_ + to_n_.dot(S_inv * to_n_);
}

Vec3 CoulombContact::solve(const Vec3& b) const noexcept {
  if (!(b[0] < 0) || !(a_nn_ > 0)) return Vec3::Zero();
  if (mu_ <= 0) return {std::min(-b[0] / a_nn_, limit_), 0, 0};
  const Vec3 stick = -inverse_ * b;
  if (stick[0] >= 0 && stick.tail<2>().squaredNorm() <= mu_ * mu_ * stick[0] * stick[0]) return stick;
  return slip(b);
}

// λ_t(c) = −(S + cI)⁻¹ g, g = b_t − a b_n, and λ_n(c) from δ_n = 0. At c = 0 friction is outside the
// cone (or λ_n < 0), for c → ∞ it vanishes while λ_n → −b_n/A_nn > 0: a root lies between. Newton runs
// on 1/‖λ_t‖ − 1/(μλ_n), which is nearly straight in c.
Vec3 CoulombContact::slip(const Vec3& b) const noexcept {
  const Eigen::Vector2d g = basis_.transpose() * (b.tail<2>() - to_n_ * b[0]);
  const Eigen::Vector2d a = basis_.transpose() * to_n_;
  const double open = -b[0] / a_nn_;
  double low = 0, high = std::numeric_limits<double>::infinity(), c = 0;
  Eigen::Vector2d t = Eigen::Vector2d::Zero();
  double n = open;
  for (int step = 0; step < max_root_steps; ++step) {
    const Eigen::Vector2d stiffness = eigenvalue_.array() + c;
    t = -g.cwiseQuotient(stiffness);
    n = open - a.dot(t);
    const double length = t.norm(), outside = length - mu_ * n;
    if (std::abs(outside) <= 2 * std::numeric_limits<double>::epsilon() * length) break;
    (outside > 0 ? low : high) = c;
    const double d_length = -(t.cwiseProduct(t).cwiseQuotient(stiffness)).sum() / length;
    const double d_n = a.dot(t.cwiseQuotient(stiffness));
    double next = -1;
    if (n > 0) {
      const double value = 1 / length - 1 / (mu_ * n);
      const double slope = -d_length / (length * length) + d_n / (mu_ * n * n);
      next = c - value / slope;
    }
    if (!(next > low && next < high))
      next = std::isinf(high) ? 2 * c + eigenvalue_.sum() : 0.5 * (low + high);
    if (next == c) break;
    c = next;
  }
  n = std::max(n, 0.0);
  const double length = t.norm();
  if (length > 0) t *= mu_ * n / length;
  const Eigen::Vector2d tangential = basis_ * t;
  return {n, tangential[0], tangential[1]};
}

Vec3 solve_coulomb_contact(const Mat3& A, const Vec3& b, double mu, double limit) noexcept {
  return CoulombContact(A, mu, limit).solve(b);
}

Vec3 project_on_cone(const Vec3& v, double mu, double limit) noexcept {
  if (mu <= 0) return {std::clamp(v[0], 0.0, limit), 0, 0};
  const double t = v.tail<2>().norm();
  if (mu * t <= -v[0]) return Vec3::Zero();
  if (t <= mu * v[0]) return v;
  const double n = (v[0] + mu * t) / (1 + mu * mu);
  const double scale = t > 0 ? mu * n / t : 0;
  return {n, scale * v[1], scale * v[2]};
}

}  // namespace hapticd
