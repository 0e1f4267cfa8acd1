#include "tools/chart/solver/drawn_contacts.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double apart = 1e12;  // compliances

MatX symmetric(const MatX& W) { return 0.5 * (W + W.transpose()); }

}  // namespace

double between(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * (static_cast<double>(random() >> 11) * 0x1p-53);
}

DrawnContacts draw_wedge(std::mt19937_64& random, int contacts, int width) {
  constexpr double coupling = 400, rotational = 0.04, size = 4e-3, wall = 1e-3, overlap = 2e-5;
  const int rows = width * contacts;
  const double angle = between(random, 0.05, 1);
  const auto push = [&] {
    const double x = between(random, -3e-4, 3e-4), y = between(random, -3e-4, 3e-4);
    return Vec3(x, y, between(random, -1e-3, -2e-4));
  };
  const Vec3 first = push(), last = push();
  DrawnContacts d;
  d.J.resize(rows, 6);
  d.q.resize(rows);
  d.motion.resize(rows);
  for (int i = 0; i < contacts; ++i) {
    const double side = i % 2 == 0 ? 1 : -1;
    const Vec3 normal(side * std::cos(angle / 2), 0, std::sin(angle / 2)), t1 = Vec3::UnitY();
    const Vec3 axes[] = {normal, t1, normal.cross(t1)};
    const double y = between(random, -size, size) / 2, z = between(random, -size, size) / 2;
    const Vec3 at(-side * size / 4, y, z);
    for (int k = 0; k < width; ++k) {
      d.J.row(width * i + k) << axes[k].transpose(), at.cross(axes[k]).transpose();
      d.q[width * i + k] = axes[k].dot(first);
      d.motion[width * i + k] = axes[k].dot(last - first);
    }
    d.q[width * i] -= overlap;
    d.mu.push_back(between(random, 0.2, 0.8));
  }
  Vec6 compliance;
  compliance << Vec3::Constant(1 / coupling), Vec3::Constant(1 / rotational);
  d.W = symmetric(d.J * compliance.asDiagonal() * d.J.transpose());
  d.W.diagonal().array() += wall / coupling;
  return d;
}

DrawnContacts draw_badly_scaled(std::mt19937_64& random, int contacts, int width) {
  const int rows = width * contacts;
  MatX B(rows, rows);
  for (double& b : B.reshaped()) b = between(random, -1, 1);
  DrawnContacts d;
  d.J = MatX::Zero(rows, 6);
  d.J.leftCols(std::min(rows, 6)) = B.leftCols(std::min(rows, 6));
  for (int i = 0; i < contacts; ++i)
    B.middleRows(width * i, width) *= std::sqrt(std::pow(apart, between(random, 0, 1)));
  d.W = symmetric(B * B.transpose());
  d.q.resize(rows);
  d.motion.resize(rows);
  for (int i = 0; i < contacts; ++i) {
    const double size = d.W.block(width * i, width * i, width, width).trace() / width;
    for (int k = width * i; k < width * (i + 1); ++k) {
      d.q[k] = size * between(random, -1, 0.3);
      d.motion[k] = size * between(random, -1, 0.3) - d.q[k];
    }
    d.mu.push_back(between(random, 0, 1.5));
  }
  return d;
}

}  // namespace hapticd
