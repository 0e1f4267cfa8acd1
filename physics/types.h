// The vocabulary of vectors, poses and twists that every folder shares.
//
// Units: m, N, kg, s, Pa, rad. World frame is right-handed. Quaternions are x, y, z, w.
// A twist is (linear velocity of the instrument's origin, angular velocity), both in world axes;
// a wrench is (force, torque about the instrument's origin), both in world axes.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace hapticd {

using Vec3 = Eigen::Vector3d;
using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat3 = Eigen::Matrix3d;
using Mat6 = Eigen::Matrix<double, 6, 6>;
using VecX = Eigen::VectorXd;
using MatX = Eigen::MatrixXd;
using Quat = Eigen::Quaterniond;

// Rigid placement: x_world = q * x_local + p. [m]
struct Pose {
  Vec3 p = Vec3::Zero();
  Quat q = Quat::Identity();

  Vec3 to_world(const Vec3& local) const noexcept { return q * local + p; }
  Vec3 to_local(const Vec3& world) const noexcept { return q.conjugate() * (world - p); }
};

// X ⊖ Y: the small twist (displacement, rotation vector; world axes) that carries Y to X.
inline Vec6 difference(const Pose& x, const Pose& y) noexcept {
  Vec6 d;
  d.head<3>() = x.p - y.p;
  Quat dq = x.q * y.q.conjugate();
  if (dq.w() < 0) dq.coeffs() = -dq.coeffs();
  const double s = dq.vec().norm();
  const double scale = s > 1e-12 ? 2.0 * std::atan2(s, dq.w()) / s : 2.0;
  d.tail<3>() = scale * dq.vec();
  return d;
}

// X ⊕ d: inverse of `difference`, so that difference(displaced(X, d), X) == d for |rotation| < π.
inline Pose displaced(const Pose& x, const Vec6& d) noexcept {
  Pose y;
  y.p = x.p + d.head<3>();
  const double angle = d.tail<3>().norm();
  Quat dq = Quat::Identity();
  if (angle > 1e-12) {
    dq = Quat(Eigen::AngleAxisd(angle, d.tail<3>() / angle));
  } else {
    dq.vec() = 0.5 * d.tail<3>();
    dq.normalize();
  }
  y.q = (dq * x.q).normalized();
  return y;
}

}  // namespace hapticd
