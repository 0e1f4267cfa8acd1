// The house frame of a device, and rotations as quaternions.
//
//   x to the right, y away from the person, z up; the tool's z along the shaft, from its tip to the hand
//
// Every kind of device gives its poses so, and a scene's `mapping` holds for all. R_house = A R_device T: A
// turns the maker's base axes into the house's, T names the tool's axes in the maker's end effector.
#pragma once

#include <array>
#include <cmath>

namespace hapticd {

using Vector = std::array<double, 3>;
using Rotation = std::array<Vector, 3>;  // rows

// Each house axis is one of the maker's, with a sign: {+2, -1, 3} means x = y', y = −x', z = z'.
struct AxisMap {
  std::array<int, 3> from;

  constexpr Vector to_house(const Vector& v) const noexcept {
    Vector out{};
    for (std::size_t i = 0; i < 3; ++i) out[i] = sign(i) * v[axis(i)];
    return out;
  }
  constexpr Vector to_maker(const Vector& v) const noexcept {
    Vector out{};
    for (std::size_t i = 0; i < 3; ++i) out[axis(i)] = sign(i) * v[i];
    return out;
  }
  constexpr double sign(std::size_t i) const noexcept { return from[i] > 0 ? 1.0 : -1.0; }
  constexpr std::size_t axis(std::size_t i) const noexcept {
    return static_cast<std::size_t>((from[i] > 0 ? from[i] : -from[i]) - 1);
  }
};

// A R T, where T's columns are the tool's axes: column j is ±column |tool.from[j]| of R.
constexpr Rotation to_house(const AxisMap& base, const Rotation& r, const AxisMap& tool) noexcept {
  Rotation out{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) out[i][j] = base.sign(i) * tool.sign(j) * r[base.axis(i)][tool.axis(j)];
  return out;
}

// x, y, z, w with w ≥ 0, by the largest of the four (Shepperd 1978); unit to rounding for any rotation.
inline std::array<double, 4> quaternion(const Rotation& r) noexcept {
  const double t = r[0][0] + r[1][1] + r[2][2];
  std::array<double, 4> q{};
  std::size_t i = 0;
  if (r[1][1] > r[0][0]) i = 1;
  if (r[2][2] > r[i][i]) i = 2;
  if (t >= r[i][i]) {
    q = {r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1], 1 + t};
  } else {
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    q[i] = 1 + r[i][i] - r[j][j] - r[k][k];
    q[j] = r[j][i] + r[i][j];
    q[k] = r[k][i] + r[i][k];
    q[3] = r[k][j] - r[j][k];
  }
  const double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (double& c : q) c /= q[3] < 0 ? -n : n;
  return q;
}

}  // namespace hapticd
