#include "tools/chart/step/drawn_blade.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace hapticd {

Instrument sheet_blade(double edge_length, int samples) {
  constexpr double from_edge = 3e-3, to = 12e-3, half_thickness = 0.05e-3;  // [m]
  Instrument i;
  i.blade = make_blade({Vec3(0, 0, -edge_length / 2), Vec3(0, 0, edge_length / 2)}, Vec3::UnitX(), samples);
  // Ground to nothing in front and below: a blunt front would push what the mesh's cut leaves beside the
  // blade's own way, up to half an element, and not cut it.
  const double top = edge_length / 2, bottom = -top, ground = edge_length / 4;
  std::vector<Vec3> corners = {{-from_edge, 0, bottom}, {-from_edge, 0, top}, {-to, 0, bottom}};
  for (const double x : {-from_edge - ground, -to})
    for (const double y : {-half_thickness, half_thickness})
      for (const double z : {bottom + ground, top}) corners.emplace_back(x, y, z);
  i.primitives = {make_convex("sheet", corners, {})};
  return i;
}

Pose drawn_blade(const BladePath& way, double t) noexcept {
  const double cut = 2 * way.from_rim / way.speed, up = way.lift / (3 * way.speed),
               aside = way.apart / way.speed;
  const double period = cut + 2 * up + aside;
  const int k = static_cast<int>(t / period);
  const double s = t - k * period;
  const auto y = [&](int n) { return (n % 2 == 0 ? 1 : -1) * way.apart * ((n + 1) / 2); };
  const bool turned = s > cut + up + 0.5 * aside;  // in the air, for the next cut
  const int of = turned ? k + 1 : k;
  const double sign = of % 2 == 0 ? 1 : -1;
  const double along = std::min(s, cut) * way.speed - way.from_rim;
  Pose X;
  X.q = Quat(Eigen::AngleAxisd(sign > 0 ? 0 : std::numbers::pi, Vec3::UnitZ()));
  X.p.x() = turned ? -sign * way.from_rim : sign * along;
  X.p.y() = y(k) + (y(k + 1) - y(k)) * std::clamp((s - cut - up) / aside, 0.0, 1.0);
  X.p.z() = way.height + way.lift * std::clamp(std::min(s - cut, period - s) / up, 0.0, 1.0);
  return X;
}

}  // namespace hapticd
