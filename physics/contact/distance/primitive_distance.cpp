#include "physics/contact/distance/primitive_distance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "physics/contact/distance/core_distance.h"

namespace hapticd {
namespace {

constexpr double patch_part = 1e-2;   // of the radii's sum: what counts as nearest, too
constexpr double parallel = 1e-7;     // sine of the angle below which two axes are parallel
constexpr double unresolved = 1e-12;  // m, a shorter difference has no direction
constexpr double round_off = 1e-12;   // m
constexpr double upright = 1e-9;      // cosine of a normal and an axis at right angles
constexpr int halvings = 44, end_halvings = 26;

struct Segment {
  Vec3 centre, axis;
  double half_length;

  Vec3 at(double s) const noexcept { return centre + s * axis; }
};

// An interval of a segment's parameter, and the middle of what the segment has of it.
struct Interval {
  double low = std::numeric_limits<double>::infinity(), high = -low;

  void join(double from, double to) noexcept {
    if (from > to) return;
    low = std::min(low, from);
    high = std::max(high, to);
  }
  double middle(double half_length, double nearest) const noexcept {
    if (low > high) return nearest;
    return 0.5 * (std::clamp(low, -half_length, nearest) + std::clamp(high, nearest, half_length));
  }
};

double square(double x) noexcept { return x * x; }

bool rounded(const Primitive& p) noexcept { return p.shape == Shape::sphere || p.shape == Shape::capsule; }

Quat axes_of(const Primitive& p, const Pose& X) noexcept { return X.q * p.placement.q; }

Vec3 origin_of(const Primitive& p, const Pose& X) noexcept { return X.to_world(p.placement.p); }

Segment axis_of(const Primitive& p, const Pose& X) noexcept {
  return {origin_of(p, X), axes_of(p, X) * Vec3::UnitZ(), p.shape == Shape::sphere ? 0 : p.half_length};
}

// The least of the crossing of the two lines and of each end against the other segment: nothing divides by a
// small angle where that could matter.
struct Crossing {
  double s, t, squared;
};

Crossing nearest_of(const Segment& a, const Segment& b) noexcept {
  const Vec3 r = b.centre - a.centre;
  const double k = a.axis.dot(b.axis), ra = r.dot(a.axis), rb = r.dot(b.axis);
  Crossing best{0, 0, std::numeric_limits<double>::infinity()};
  const auto consider = [&](double s, double t) {
    const double squared = (r + t * b.axis - s * a.axis).squaredNorm();
    if (squared < best.squared) best = {s, t, squared};
  };
  const double sine = a.axis.cross(b.axis).squaredNorm();
  if (sine > square(parallel)) {
    const double s = (ra - k * rb) / sine, t = (k * ra - rb) / sine;
    if (std::abs(s) <= a.half_length && std::abs(t) <= b.half_length) consider(s, t);
  }
  for (const double side : {-1.0, 1.0}) {
    const double s = side * a.half_length, t = side * b.half_length;
    consider(s, std::clamp(k * s - rb, -b.half_length, b.half_length));
    consider(std::clamp(ra + k * t, -a.half_length, a.half_length), t);
  }
  return best;
}

// The part of the line of a that lies within `reach` of the segment b: a capsule, which is a cylinder and two
// balls.
Interval line_within(const Segment& a, const Segment& b, double reach) noexcept {
  constexpr double all = 1e9;
  Interval interval;
  const Vec3 from_b = a.centre - b.centre;
  const double k = a.axis.dot(b.axis);
  for (const double end : {-b.half_length, b.half_length}) {
    const Vec3 q = from_b - end * b.axis;
    const double along = a.axis.dot(q);
    const double left = square(reach) - (q - along * a.axis).squaredNorm();
    if (left >= 0) interval.join(-along - std::sqrt(left), -along + std::sqrt(left));
  }
  const double height = from_b.dot(b.axis);
  const Vec3 q = from_b - height * b.axis, d = a.axis - k * b.axis;
  const double slope = d.squaredNorm();
  double low = -all, high = all;
  if (slope > square(parallel)) {
    const double nearest = -d.dot(q) / slope;
    const double left = square(reach) - (q + nearest * d).squaredNorm();
    if (left < 0) return interval;
    low = nearest - std::sqrt(left / slope);
    high = nearest + std::sqrt(left / slope);
  } else if (q.squaredNorm() > square(reach)) {
    return interval;
  }
  if (std::abs(k) > parallel) {
    const double one = (-b.half_length - height) / k, other = (b.half_length - height) / k;
    interval.join(std::max(low, std::min(one, other)), std::min(high, std::max(one, other)));
  } else if (std::abs(height) <= b.half_length) {
    interval.join(low, high);
  }
  return interval;
}

// Of two segments that cross: any direction at right angles to both parts them as well; toward b where that
// tells.
Vec3 normal_of_crossing(const Segment& a, const Segment& b) noexcept {
  const Vec3 between = b.centre - a.centre, across = a.axis.cross(b.axis);
  Vec3 n = across;
  if (a.half_length == 0 && b.half_length == 0) return Vec3::UnitZ();
  if (b.half_length == 0)
    n = a.axis.unitOrthogonal();
  else if (a.half_length == 0)
    n = b.axis.unitOrthogonal();
  else if (across.norm() < parallel)
    n = a.axis.unitOrthogonal();
  n.normalize();
  return n.dot(between) < 0 ? Vec3(-n) : n;
}

// The middle of two points, moved apart to the surfaces.
PrimitiveGap around(const Vec3& middle, double distance, const Vec3& n) noexcept {
  return {distance, n, middle - 0.5 * distance * n, middle + 0.5 * distance * n};
}

PrimitiveGap between_segments(const Segment& a, double radius_a, const Segment& b, double radius_b) noexcept {
  const Crossing nearest = nearest_of(a, b);
  const double length = std::sqrt(nearest.squared);
  const Vec3 n =
      length > unresolved ? Vec3((b.at(nearest.t) - a.at(nearest.s)) / length) : normal_of_crossing(a, b);
  const double reach = length + patch_part * (radius_a + radius_b);
  const double s = line_within(a, b, reach).middle(a.half_length, nearest.s);
  const double t = line_within(b, a, reach).middle(b.half_length, nearest.t);
  const Vec3 middle = 0.5 * (a.at(s) + radius_a * n + b.at(t) - radius_b * n);
  return around(middle, length - radius_a - radius_b, n);
}

// Signed distance of a cylinder at c + t u and its slope's sign, in the cylinder's frame: gap_at without its
// normal.
struct OnLine {
  double radius, half_length;
  Vec3 c, u;

  double at(double t, bool& falls) const noexcept {
    const Vec3 x = c + t * u;
    const double r = x.head<2>().norm(), along = x.head<2>().dot(u.head<2>()), dr = r - radius;
    const double dz = std::abs(x.z()) - half_length, uz = x.z() < 0 ? -u.z() : u.z();
    if (dr > 0 && dz > 0) {
      falls = dr * along + r * dz * uz < 0;
      return std::sqrt(dr * dr + dz * dz);
    }
    falls = (dr > dz ? along : uz) < 0;
    return std::max(dr, dz);
  }
};

// f(t) = sd of the cylinder at the point t of the segment is convex: its slope's sign brackets the least, its
// values the ends of what counts as nearest. False where the segment enters the cylinder: there the least of
// f is but a bound.
bool from_cylinder(const Primitive& cylinder, const Pose& X, const Segment& b, double radius,
                   PrimitiveGap& out) noexcept {
  const Mat3 to_local = axes_of(cylinder, X).conjugate().toRotationMatrix();
  const OnLine f{cylinder.radius, cylinder.half_length, to_local * (b.centre - origin_of(cylinder, X)),
                 to_local * b.axis};
  bool falls;
  double low = -b.half_length, high = b.half_length;
  for (int k = 0; k < halvings && low < high; ++k) {
    const double t = 0.5 * (low + high);
    f.at(t, falls);
    (falls ? low : high) = t;
  }
  const double nearest = 0.5 * (low + high);
  const Gap gap = gap_at(cylinder, f.c + nearest * f.u);
  if (gap.distance <= 0 && b.half_length > 0) return false;
  const double level = gap.distance + patch_part * (cylinder.radius + radius);
  double end[2] = {-b.half_length, b.half_length};
  for (double& side : end) {
    double inside = nearest, outside = side;
    if (f.at(outside, falls) <= level) continue;
    for (int k = 0; k < end_halvings; ++k) {
      const double t = 0.5 * (inside + outside);
      (f.at(t, falls) <= level ? inside : outside) = t;
    }
    side = inside;
  }
  const Vec3 n = to_local.transpose() * gap.normal;
  const double distance = gap.distance - radius;
  const Vec3 on_b = b.at(0.5 * (end[0] + end[1])) - radius * n;
  out = {distance, n, on_b - distance * n, on_b};
  return true;
}

PrimitiveGap mirrored(const PrimitiveGap& gap) noexcept {
  return {gap.distance, -gap.normal, gap.on_b, gap.on_a};
}

Core core_of(const Primitive& p, const Pose& X) noexcept {
  Core core{CoreShape::segment,
            axes_of(p, X).toRotationMatrix(),
            origin_of(p, X),
            {},
            p.radius,
            p.half_length,
            nullptr};
  core.centre = core.origin;
  if (p.shape == Shape::sphere) core.half_length = 0;
  if (p.shape == Shape::cylinder) core.shape = CoreShape::cylinder;
  if (p.shape != Shape::convex) return core;
  core.shape = CoreShape::hull;
  core.hull = &p;
  Vec3 sum = Vec3::Zero();
  for (const Vec3& v : p.vertices) sum += v;
  if (!p.vertices.empty()) core.centre += core.R * (sum / static_cast<double>(p.vertices.size()));
  return core;
}

}  // namespace

PrimitiveGap gap_between(const Primitive& a, const Pose& X_a, const Primitive& b, const Pose& X_b) noexcept {
  if (rounded(a) && rounded(b)) return between_segments(axis_of(a, X_a), a.radius, axis_of(b, X_b), b.radius);
  PrimitiveGap gap;
  if (a.shape == Shape::cylinder && rounded(b) && from_cylinder(a, X_a, axis_of(b, X_b), b.radius, gap))
    return gap;
  if (b.shape == Shape::cylinder && rounded(a) && from_cylinder(b, X_b, axis_of(a, X_a), a.radius, gap))
    return mirrored(gap);
  // Cylinders lie inside the capsules of their axes. Side by side the capsules' gap is theirs.
  const bool cylinders = a.shape == Shape::cylinder && b.shape == Shape::cylinder;
  if (cylinders) {
    const Segment axis_a = axis_of(a, X_a), axis_b = axis_of(b, X_b);
    gap = between_segments(axis_a, a.radius, axis_b, b.radius);
    const double tilt =
        std::max(std::abs(gap.normal.dot(axis_a.axis)), std::abs(gap.normal.dot(axis_b.axis)));
    if (gap.distance > 0 && tilt < upright) return gap;
  }
  Core core_a = core_of(a, X_a), core_b = core_of(b, X_b);
  const Vec3 origin = core_a.centre;  // small numbers
  for (Core* core : {&core_a, &core_b}) {
    core->origin -= origin;
    core->centre -= origin;
  }
  const CoreGap core = core_gap(core_a, core_b);
  const double radius_a = rounded(a) ? a.radius : 0, radius_b = rounded(b) ? b.radius : 0;
  Vec3 middle = origin + 0.5 * (core.on_a + radius_a * core.normal + core.on_b - radius_b * core.normal);
  if (cylinders) {
    const double patch = std::max(round_off, patch_part * (a.radius + b.radius));
    const double beside = std::clamp(1 - (core.distance - gap.distance) / patch, 0.0, 1.0);
    middle += beside * (0.5 * (gap.on_a + gap.on_b) - middle);
  }
  return around(middle, core.distance - radius_a - radius_b, core.normal);
}

bool near(const Primitive& a, const Pose& X_a, const Primitive& b, const Pose& X_b, double reach) noexcept {
  const auto bounds = [](const Primitive& p, const Pose& X, double& radius) {
    radius = p.radius;
    if (p.shape != Shape::convex) return axis_of(p, X);
    double squared = 0;
    for (const Vec3& v : p.vertices) squared = std::max(squared, v.squaredNorm());
    radius = std::sqrt(squared);
    return Segment{origin_of(p, X), Vec3::UnitZ(), 0};
  };
  double radius_a, radius_b;
  const Segment axis_a = bounds(a, X_a, radius_a), axis_b = bounds(b, X_b, radius_b);
  const double grown = radius_a + radius_b + reach + round_off;
  return grown > 0 && nearest_of(axis_a, axis_b).squared <= square(grown);
}

}  // namespace hapticd
