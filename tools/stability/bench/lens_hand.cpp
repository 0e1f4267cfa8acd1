#include "tools/stability/bench/lens_hand.h"

#include <cmath>

namespace hapticd {
namespace {

constexpr double pole = 1.75e-3, curvature = 10e-3, posterior_centre = -2.45e-3 + 6e-3,
                 posterior_curvature = 6e-3;
constexpr double tip_radius = 0.5e-3;
const Vec3 incision(0, -4.2e-3, -1.9e-3 + 6.2438e-3);
// make_trajectories.py: 4.6 mm out, at −165°.
const Vec3 side_port(-4.4433e-3, -1.1906e-3, -1.9e-3 + 5.9553e-3);

Quat through(const Vec3& port, const Vec3& tip) {
  const Vec3 z = (port - tip).normalized(), x = Vec3(-z.y(), z.x(), 0).normalized();
  Mat3 R;
  R << x, z.cross(x), z;
  return Quat(R).normalized();
}

double below(double radius, double x, double y) { return std::sqrt(radius * radius - x * x - y * y); }

}  // namespace

Vec3 over_lens(double x, double y, double depth) {
  return {x, y, pole - curvature + below(curvature, x, y) + tip_radius - depth};
}

Vec3 on_posterior(double x, double y) {
  return {x, y, posterior_centre - below(posterior_curvature - tip_radius, x, y)};
}

Quat through_incision(const Vec3& tip) { return through(incision, tip); }
Quat through_side_port(const Vec3& tip) { return through(side_port, tip); }

}  // namespace hapticd
