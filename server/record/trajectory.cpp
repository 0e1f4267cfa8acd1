#include "server/record/trajectory.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace hapticd {
namespace {

Quat exponential(const Vec3& rotation) {
  return displaced(Pose{}, (Vec6() << Vec3::Zero(), rotation).finished()).q;
}

// Rotation vector from a to b, in a's axes.
Vec3 rotation_between(const Quat& a, const Quat& b) {
  return difference({Vec3::Zero(), a.conjugate() * b}, Pose{}).tail<3>();
}

// Second derivatives m of the natural spline, by elimination on the tridiagonal system
//   h_{i−1} m_{i−1} + 2 (h_{i−1} + h_i) m_i + h_i m_{i+1} = 6 (s_i − s_{i−1}),  s the slopes, m_0 = m_n = 0.
std::vector<Vec3> spline_accelerations(const std::vector<TrajectorySample>& x) {
  const std::size_t n = x.size();
  std::vector<Vec3> m(n, Vec3::Zero());
  std::vector<double> upper(n, 0);
  const auto h = [&](std::size_t i) { return x[i + 1].t - x[i].t; };
  const auto slope = [&](std::size_t i) -> Vec3 { return (x[i + 1].pose.p - x[i].pose.p) / h(i); };
  for (std::size_t i = 1; i + 1 < n; ++i) {
    const double pivot = 2 * (h(i - 1) + h(i)) - h(i - 1) * upper[i - 1];
    upper[i] = h(i) / pivot;
    m[i] = (6 * (slope(i) - slope(i - 1)) - h(i - 1) * m[i - 1]) / pivot;
  }
  for (std::size_t i = n - 2; i >= 1; --i) m[i] -= upper[i] * m[i + 1];
  return m;
}

std::vector<Vec3> angular_velocities(const std::vector<TrajectorySample>& x) {
  const std::size_t n = x.size();
  std::vector<Vec3> w(n);
  const auto h = [&](std::size_t i) { return x[i + 1].t - x[i].t; };
  const auto rate = [&](std::size_t i) -> Vec3 {
    return rotation_between(x[i].pose.q, x[i + 1].pose.q) / h(i);
  };
  w.front() = rate(0);
  w.back() = rate(n - 2);
  for (std::size_t i = 1; i + 1 < n; ++i)
    w[i] = (h(i) * rate(i - 1) + h(i - 1) * rate(i)) / (h(i - 1) + h(i));
  return w;
}

// Index of the last sample at or before t; t lies within the trajectory.
std::size_t interval(const std::vector<TrajectorySample>& x, double t) {
  const auto after = std::upper_bound(x.begin(), x.end(), t,
                                      [](double time, const TrajectorySample& s) { return time < s.t; });
  return static_cast<std::size_t>(after - x.begin()) - 1;
}

}  // namespace

Trajectory make_trajectory(std::vector<TrajectorySample> samples) {
  if (samples.size() < 2) throw std::invalid_argument("a trajectory needs two samples at least");
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (i > 0 && !(samples[i].t > samples[i - 1].t))
      throw std::invalid_argument("a trajectory's times must rise (sample " + std::to_string(i) + ")");
    // The same rotation on the near side, so that neighbours are never more than half a turn apart.
    if (i > 0 && samples[i].pose.q.dot(samples[i - 1].pose.q) < 0) samples[i].pose.q.coeffs() *= -1;
  }
  Trajectory trajectory;
  trajectory.acceleration = spline_accelerations(samples);
  trajectory.angular_velocity = angular_velocities(samples);
  trajectory.samples = std::move(samples);
  return trajectory;
}

Pose sample_at(const Trajectory& trajectory, double t) {
  const std::vector<TrajectorySample>& x = trajectory.samples;
  if (!(t > x.front().t)) return x.front().pose;
  if (t >= x.back().t) return x.back().pose;
  const std::size_t i = interval(x, t);
  const TrajectorySample &a = x[i], &b = x[i + 1];
  const double h = b.t - a.t, u = (t - a.t) / h, v = 1 - u;
  if (u == 0) return a.pose;

  Pose pose;
  pose.p =
      v * a.pose.p + u * b.pose.p +
      h * h / 6 *
          ((v * v * v - v) * trajectory.acceleration[i] + (u * u * u - u) * trajectory.acceleration[i + 1]);

  // Cumulative cubic Bernstein weights, and the three rotations they scale.
  const double b1 = 1 - v * v * v, b2 = u * u * (3 - 2 * u), b3 = u * u * u;
  const Vec3 first = h / 3 * trajectory.angular_velocity[i],
             last = h / 3 * trajectory.angular_velocity[i + 1];
  const Vec3 middle = rotation_between(a.pose.q * exponential(first), b.pose.q * exponential(-last));
  pose.q =
      (a.pose.q * exponential(b1 * first) * exponential(b2 * middle) * exponential(b3 * last)).normalized();
  return pose;
}

std::uint32_t buttons_at(const Trajectory& trajectory, double t) {
  const std::vector<TrajectorySample>& x = trajectory.samples;
  if (!(t > x.front().t)) return x.front().buttons;
  return x[std::min(interval(x, t), x.size() - 1)].buttons;
}

}  // namespace hapticd
