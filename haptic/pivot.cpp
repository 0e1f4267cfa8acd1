#include "haptic/pivot.h"

namespace hapticd {
namespace {

constexpr double shortest = 1e-3;  // a tip nearer to the point than this has no direction [m]
constexpr double opposite = 1e-6;  // 1 + z·u of a stylus that points against the shaft

struct Shaft {
  Vec3 u, z;      // the shaft's direction, the stylus's
  double length;  // |v|
  bool raised;
  double facing;  // 1 + z·u
};

Shaft shaft_of(const Pivot& pivot, const Pose& stylus) noexcept {
  Shaft s;
  Vec3 v = pivot.point - stylus.p;
  const double depth = v.dot(pivot.axis);
  s.raised = depth < shortest;
  if (s.raised) v += (shortest - depth) * pivot.axis;
  s.length = v.norm();
  s.u = v / s.length;
  s.z = stylus.q * Vec3::UnitZ();
  s.facing = 1 + s.z.dot(s.u);
  return s;
}

}  // namespace

Pose through_pivot(const Pivot& pivot, const Pose& stylus) noexcept {
  const Shaft s = shaft_of(pivot, stylus);
  Quat turn;
  if (s.facing > opposite) {
    turn.w() = s.facing;
    turn.vec() = s.z.cross(s.u);
  } else {
    turn.w() = 0;
    turn.vec() = stylus.q * Vec3::UnitX();
  }
  return {stylus.p, (turn.normalized() * stylus.q).normalized()};
}

// ω = (I − u zᵀ/(1 + z·u)) (u × v̇)/|v| of a tip that moves, u (z + u)ᵀ/(1 + z·u) ω_stylus of a stylus that
// turns.
Vec6 on_stylus(const Pivot& pivot, const Pose& stylus, const Vec6& wrench) noexcept {
  const Shaft s = shaft_of(pivot, stylus);
  const Vec3 torque = wrench.tail<3>();
  const double along = s.facing > opposite ? s.u.dot(torque) / s.facing : 0;
  Vec3 lever = s.u.cross(torque - along * s.z) / s.length;
  if (s.raised) lever -= pivot.axis * pivot.axis.dot(lever);
  Vec6 on;
  on.head<3>() = wrench.head<3>() + lever;
  on.tail<3>() = along * (s.z + s.u);
  return on;
}

}  // namespace hapticd
