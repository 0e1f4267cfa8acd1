#include "physics/tissue/inside.h"

#include <cmath>
#include <numbers>

namespace hapticd {

bool is_inside(std::span<const SurfaceFace> faces, std::span<const Vec3> x, const Vec3& point) noexcept {
  double angle = 0;
  for (const SurfaceFace& f : faces) {
    const Vec3 a = x[f.nodes[0]] - point, b = x[f.nodes[1]] - point, c = x[f.nodes[2]] - point;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    angle += 2 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return angle > 2 * std::numbers::pi;
}

}  // namespace hapticd
