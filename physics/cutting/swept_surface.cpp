#include "physics/cutting/swept_surface.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hapticd {

namespace {

constexpr double touching = 1e-9;  // relative to the lengths compared

// The point of the triangle nearest to p: Ericson, Real-Time Collision Detection, §5.1.5.
Vec3 nearest_point(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) noexcept {
  const Vec3 ab = b - a;
  const Vec3 ac = c - a;
  const double d1 = ab.dot(p - a), d2 = ac.dot(p - a);
  if (d1 <= 0 && d2 <= 0) return a;
  const double d3 = ab.dot(p - b), d4 = ac.dot(p - b);
  if (d3 >= 0 && d4 <= d3) return b;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
  const double d5 = ab.dot(p - c), d6 = ac.dot(p - c);
  if (d6 >= 0 && d5 <= d6) return c;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  return a + (vb * ab + vc * ac) / (va + vb + vc);
}

}  // namespace

void SweptSurface::add(const Vec3& a, const Vec3& b, const Vec3& c) noexcept {
  const Vec3 area = (b - a).cross(c - a);
  const double longest = std::max({(b - a).squaredNorm(), (c - a).squaredNorm(), (c - b).squaredNorm()});
  if (!(area.norm() > touching * longest)) return;
  triangles_.push_back({a, b, c, area.normalized()});
}

void SweptSurface::sweep(std::span<const Vec3> from, std::span<const Vec3> to) noexcept {
  for (std::size_t i = 0; i + 1 < from.size(); ++i) {
    add(from[i], from[i + 1], to[i]);
    add(from[i + 1], to[i + 1], to[i]);
  }
}

// A segment through an edge that two triangles share goes through both: it counts once for each place and
// way.
std::optional<double> SweptSurface::crossing(const Vec3& a, const Vec3& b) const noexcept {
  std::optional<double> up, down;
  const double small = touching * (b - a).norm();
  for (const Facet& t : triangles_) {
    const double above_a = (a - t.a).dot(t.normal);
    const double above_b = (b - t.a).dot(t.normal);
    if (std::min(above_a, above_b) > small || std::max(above_a, above_b) < -small ||
        std::abs(above_a - above_b) <= 2 * small)
      continue;
    const double s = std::clamp(above_a / (above_a - above_b), 0.0, 1.0);
    const Vec3 p = a + s * (b - a);
    const auto left_of = [&](const Vec3& x, const Vec3& y) {
      return (y - x).cross(p - x).dot(t.normal) >= -touching * (y - x).squaredNorm();
    };
    if (!left_of(t.a, t.b) || !left_of(t.b, t.c) || !left_of(t.c, t.a)) continue;
    (above_b > above_a ? up : down) = s;
  }
  if (up && down) return std::nullopt;
  return up ? up : down;
}

double SweptSurface::side(const Vec3& p) const noexcept {
  const Facet& t = nearest(p);
  return (p - t.a).dot(t.normal);
}

const SweptSurface::Facet& SweptSurface::nearest(const Vec3& p) const noexcept {
  double least = std::numeric_limits<double>::infinity();
  double height = 0;
  const Facet* found = triangles_.data();
  for (const Facet& t : triangles_) {
    const double distance = (p - nearest_point(p, t.a, t.b, t.c)).norm();
    const double above = (p - t.a).dot(t.normal);
    // Of triangles that are equally near, that which p is most above or below of.
    if (distance > (1 + touching) * least ||
        (distance >= (1 - touching) * least && std::abs(above) <= std::abs(height)))
      continue;
    least = distance;
    height = above;
    found = &t;
  }
  return *found;
}

Eigen::AlignedBox3d SweptSurface::box() const noexcept {
  Eigen::AlignedBox3d box;
  for (const Facet& t : triangles_) box.extend(t.a).extend(t.b).extend(t.c);
  return box;
}

}  // namespace hapticd
