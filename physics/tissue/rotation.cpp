#include "physics/tissue/rotation.h"

#include <cmath>
#include <utility>

namespace hapticd {

namespace {

constexpr int newton_steps = 10;
constexpr int jacobi_sweeps = 12;
constexpr double definite = 1e-9;  // smallest pivot of tr(A) I − sym A relative to |F| that Newton trusts
constexpr double tie = 1e-9;       // σ₂ + σ₃ relative to σ₁ below which nearest rotations count as equal

// One step of Newton–Schulz: squares the distance of R from orthogonality.
Mat3 orthonormalised(const Mat3& R) noexcept {
  return R * (1.5 * Mat3::Identity() - 0.5 * (R.transpose() * R));
}

// The rotation of the quaternion (1, δ/2), normalised: equals exp(δ×) up to third order, exactly orthogonal.
Mat3 small_rotation(const Vec3& delta) noexcept {
  const Vec3 q = 0.5 * delta;
  const double s = 2.0 / (1.0 + q.squaredNorm());
  Mat3 R = s * q * q.transpose();
  R.diagonal().array() += 1.0 - s * q.squaredNorm();
  R(0, 1) -= s * q.z();
  R(1, 0) += s * q.z();
  R(0, 2) += s * q.y();
  R(2, 0) -= s * q.y();
  R(1, 2) -= s * q.x();
  R(2, 1) += s * q.x();
  return R;
}

// δ of the header by LDLᵀ; false when the matrix is not safely positive definite.
bool newton_step(const Mat3& A, double smallest_pivot, Vec3& delta) noexcept {
  const Vec3 w(A(2, 1) - A(1, 2), A(0, 2) - A(2, 0), A(1, 0) - A(0, 1));
  const double h10 = -0.5 * (A(1, 0) + A(0, 1));
  const double h20 = -0.5 * (A(2, 0) + A(0, 2));
  const double h21 = -0.5 * (A(2, 1) + A(1, 2));
  const double d0 = A(1, 1) + A(2, 2);
  if (!(d0 > smallest_pivot)) return false;
  const double l10 = h10 / d0;
  const double l20 = h20 / d0;
  const double d1 = A(0, 0) + A(2, 2) - l10 * h10;
  if (!(d1 > smallest_pivot)) return false;
  const double l21 = (h21 - l20 * h10) / d1;
  const double d2 = A(0, 0) + A(1, 1) - l20 * h20 - l21 * l21 * d1;
  if (!(d2 > smallest_pivot)) return false;
  const double y1 = w[1] - l10 * w[0];
  const double y2 = w[2] - l20 * w[0] - l21 * y1;
  delta[2] = y2 / d2;
  delta[1] = y1 / d1 - l21 * delta[2];
  delta[0] = w[0] / d0 - l10 * delta[1] - l20 * delta[2];
  return true;
}

// Turns columns i and j of B (and of V) until they are orthogonal; true if they already were.
bool rotate_columns(Mat3& B, Mat3& V, int i, int j) noexcept {
  const double p = B.col(i).dot(B.col(j));
  const double a = B.col(i).squaredNorm();
  const double b = B.col(j).squaredNorm();
  if (std::abs(p) <= 1e-16 * std::sqrt(a * b)) return true;
  const double zeta = (b - a) / (2 * p);
  const double t = (zeta >= 0 ? 1.0 : -1.0) / (std::abs(zeta) + std::sqrt(1 + zeta * zeta));
  const double c = 1 / std::sqrt(1 + t * t);
  const double s = c * t;
  for (Mat3* M : {&B, &V}) {
    const Vec3 m = M->col(i);
    M->col(i) = c * m - s * M->col(j);
    M->col(j) = s * m + c * M->col(j);
  }
  return false;
}

// Swaps two columns and keeps the determinant.
void exchange_columns(Mat3& M, int i, int j) noexcept {
  const Vec3 m = M.col(i);
  M.col(i) = M.col(j);
  M.col(j) = -m;
}

}  // namespace

Mat3 nearest_rotation_by_svd(const Mat3& F, const Mat3& start) noexcept {
  const double size = F.cwiseAbs().maxCoeff();
  if (!(size > 0) || !std::isfinite(size) || !F.allFinite()) return start;

  // F V = B with orthogonal columns, longest first; V stays a proper rotation throughout.
  Mat3 B = F / size;
  Mat3 V = Mat3::Identity();
  for (int sweep = 0; sweep < jacobi_sweeps; ++sweep) {
    bool done = rotate_columns(B, V, 0, 1);
    done &= rotate_columns(B, V, 0, 2);
    done &= rotate_columns(B, V, 1, 2);
    if (done) break;
  }
  for (const auto& [i, j] : {std::pair{0, 1}, std::pair{0, 2}, std::pair{1, 2}}) {
    if (B.col(i).squaredNorm() >= B.col(j).squaredNorm()) continue;
    exchange_columns(B, i, j);
    exchange_columns(V, i, j);
  }

  // U is proper by construction, so the third singular value carries the sign of det F.
  const double sigma1 = B.col(0).norm();
  Mat3 U;
  U.col(0) = B.col(0) / sigma1;
  Vec3 second = B.col(1) - U.col(0) * U.col(0).dot(B.col(1));
  if (second.norm() <= 1e-14 * sigma1) second = U.col(0).unitOrthogonal();
  U.col(1) = second.normalized();
  U.col(2) = U.col(0).cross(U.col(1));
  const double sigma2 = U.col(1).dot(B.col(1));
  const double sigma3 = U.col(2).dot(B.col(2));

  if (sigma2 + sigma3 <= tie * sigma1) {
    // Any turn about the first axis is as near: take the one nearest to `start`.
    const Mat3 T = U.transpose() * start * V;
    const double angle = std::atan2(T(2, 1) - T(1, 2), T(1, 1) + T(2, 2));
    U = U * Eigen::AngleAxisd(angle, Vec3::UnitX());
  }
  return U * V.transpose();
}

Mat3 nearest_rotation(const Mat3& F, const Mat3& start) noexcept {
  const double size = F.norm();
  if (!(size > 0) || !std::isfinite(size)) return start;
  Mat3 R = orthonormalised(start);
  double value = -2 * size;
  for (int step = 0; step < newton_steps; ++step) {
    const Mat3 A = R.transpose() * F;
    Vec3 delta;
    // A step that lowers tr(RᵀF) left the maximum's basin.
    if (A.trace() < value - 1e-12 * size || !newton_step(A, definite * size, delta)) break;
    value = A.trace();
    const double length = delta.norm();
    if (length > 1) delta /= length;
    R = R * small_rotation(delta);
    if (length <= 1e-8) return R;
  }
  return nearest_rotation_by_svd(F, start);
}

}  // namespace hapticd
