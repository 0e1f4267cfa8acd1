#include "physics/contact/instrument.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hapticd {
namespace {

// v / |v|, or `fallback` where v has no direction; `length` receives |v|.
Vec3 direction(const Vec3& v, const Vec3& fallback, double& length) noexcept {
  length = v.norm();
  return length > std::numeric_limits<double>::min() ? Vec3(v / length) : fallback;
}

Gap sphere_gap(double radius, const Vec3& x) noexcept {
  double length;
  const Vec3 n = direction(x, Vec3::UnitZ(), length);
  return {length - radius, n, 0};
}

Gap capsule_gap(double radius, double half_length, const Vec3& x) noexcept {
  const double z = std::clamp(x.z(), -half_length, half_length);
  double length;
  const Vec3 n = direction(x - Vec3(0, 0, z), Vec3::UnitX(), length);
  return {length - radius, n, 0};
}

// In the half plane (r, |z|) the cylinder is a corner: outside it the distance is to the corner or to
// one of the two walls, inside it is to the nearer wall.
Gap cylinder_gap(double radius, double half_length, const Vec3& x) noexcept {
  double r;
  const Vec3 radial = direction(Vec3(x.x(), x.y(), 0), Vec3::UnitX(), r);
  const Vec3 axial(0, 0, x.z() < 0 ? -1.0 : 1.0);
  const double dr = r - radius, dz = std::abs(x.z()) - half_length;
  if (dr > 0 && dz > 0) {
    double length;
    const Vec3 n = direction(dr * radial + dz * axial, axial, length);
    return {length, n, 0};
  }
  return dr > dz ? Gap{dr, radial, 0} : Gap{dz, axial, 0};
}

Gap convex_gap(const std::vector<Eigen::Vector4d>& planes, const Vec3& x) noexcept {
  Gap gap{-std::numeric_limits<double>::infinity(), Vec3::UnitZ(), 0};
  for (const Eigen::Vector4d& plane : planes) {
    const double d = plane.head<3>().dot(x) + plane[3];
    if (d > gap.distance) gap = {d, plane.head<3>(), 0};
  }
  return gap;
}

}  // namespace

Gap gap_at(const Primitive& p, const Vec3& local) noexcept {
  switch (p.shape) {
    case Shape::sphere:
      return sphere_gap(p.radius, local);
    case Shape::capsule:
      return capsule_gap(p.radius, p.half_length, local);
    case Shape::cylinder:
      return cylinder_gap(p.radius, p.half_length, local);
    case Shape::convex:
      break;
  }
  return convex_gap(p.planes, local);
}

Gap gap_at(const Instrument& instrument, const Pose& X, const Vec3& x) noexcept {
  const Vec3 at = X.to_local(x);
  Gap nearest{std::numeric_limits<double>::infinity(), Vec3::UnitZ(), -1};
  for (std::size_t k = 0; k < instrument.primitives.size(); ++k) {
    const Primitive& p = instrument.primitives[k];
    const Gap gap = gap_at(p, p.placement.to_local(at));
    if (gap.distance < nearest.distance) nearest = {gap.distance, gap.normal, static_cast<int>(k)};
  }
  if (nearest.primitive >= 0)
    nearest.normal = X.q * (instrument.primitives[nearest.primitive].placement.q * nearest.normal);
  return nearest;
}

Vec3 support(const Primitive& p, const Pose& X, const Vec3& d) noexcept {
  const Vec3 local = (X.q * p.placement.q).conjugate() * d;
  const Vec3 end(0, 0, local.z() < 0 ? -p.half_length : p.half_length);
  double length;
  Vec3 point = Vec3::Zero();
  switch (p.shape) {
    case Shape::sphere:
      point = p.radius * direction(local, Vec3::UnitZ(), length);
      break;
    case Shape::capsule:
      point = end + p.radius * direction(local, Vec3::UnitZ(), length);
      break;
    case Shape::cylinder:
      point = end + p.radius * direction(Vec3(local.x(), local.y(), 0), Vec3::UnitX(), length);
      break;
    case Shape::convex: {
      double farthest = -std::numeric_limits<double>::infinity();
      for (const Vec3& v : p.vertices)
        if (v.dot(local) > farthest) {
          farthest = v.dot(local);
          point = v;
        }
      break;
    }
  }
  return X.to_world(p.placement.to_world(point));
}

}  // namespace hapticd
