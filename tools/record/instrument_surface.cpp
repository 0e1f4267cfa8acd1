#include "tools/record/instrument_surface.h"

#include <cmath>
#include <numbers>
#include <utility>

namespace hapticd {
namespace {

constexpr std::size_t floats_each = 10;
constexpr int around = 16, of_a_quarter = 4;
enum Code { sphere = 0, capsule = 1, cylinder = 2, triangle = 3 };

using Profile = std::vector<std::pair<double, double>>;  // from the axis, along it

Profile profile_of(int code, double radius, double half_length) {
  if (code == cylinder)
    return {{0, half_length}, {radius, half_length}, {radius, -half_length}, {0, -half_length}};
  Profile out;
  const double half = code == capsule ? half_length : 0;
  for (const double side : {1.0, -1.0})
    for (int i = 0; i <= of_a_quarter; ++i) {
      const double a = 0.5 * std::numbers::pi * (side > 0 ? i : of_a_quarter - i) / of_a_quarter;
      out.emplace_back(radius * std::sin(a), side * (half + radius * std::cos(a)));
    }
  return out;
}

void revolve(const Profile& profile, const Vec3& place, const Quat& turn, std::vector<Vec3>& out) {
  const auto corner = [&](std::size_t i, int k) -> Vec3 {
    const double a = 2 * std::numbers::pi * k / around;
    return place +
           turn * Vec3(profile[i].first * std::cos(a), profile[i].first * std::sin(a), profile[i].second);
  };
  for (std::size_t i = 0; i + 1 < profile.size(); ++i) {
    if (profile[i] == profile[i + 1]) continue;
    for (int k = 0; k < around; ++k) {
      if (profile[i].first > 0) out.insert(out.end(), {corner(i, k), corner(i + 1, k), corner(i, k + 1)});
      if (profile[i + 1].first > 0)
        out.insert(out.end(), {corner(i, k + 1), corner(i + 1, k), corner(i + 1, k + 1)});
    }
  }
}

}  // namespace

std::vector<Vec3> instrument_surface(std::span<const float> primitives) {
  std::vector<Vec3> out;
  for (std::size_t at = 0; at + floats_each <= primitives.size(); at += floats_each) {
    const float* p = primitives.data() + at;
    const int code = static_cast<int>(p[0]);
    if (code == triangle)
      for (int c = 0; c < 3; ++c) out.emplace_back(p[1 + 3 * c], p[2 + 3 * c], p[3 + 3 * c]);
    else if (code == sphere || code == capsule || code == cylinder)
      revolve(profile_of(code, p[1], p[2]), {p[3], p[4], p[5]}, Quat(p[9], p[6], p[7], p[8]), out);
  }
  return out;
}

}  // namespace hapticd
