// GJK finds the point v of M = B − A nearest to the origin from a simplex of support points. It is
// ill-conditioned where A and B touch and silent where they overlap, so there b is first moved away by s n,
// with n a unit vector and s = −g(n) + margin: then they are apart by the margin at least. With m = v/|v| of
// the moved pair,
//
//   |v| = max over u of (s n·u + g(u)) = s n·m + g(m)  ≥  s + g(n)   ⇒   g(m) ≥ g(n) + s (1 − n·m)
//
// so n ← m never descends, and it is at rest only at a local maximum. Where the surface of M has the radius
// of curvature ρ and the depth is D, the angle to rest shrinks by s/(s + ρ − D) each turn: at once on flats,
// by D/ρ on round ones.
#include "physics/contact/distance/core_distance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace hapticd {
namespace {

constexpr int max_supports = 48, max_turns = 12;
constexpr double closed = 1e-13;         // duality gap of GJK, relative to v²
constexpr double roughly_closed = 1e-3;  // ... in the first turn
constexpr double finer = 1e-2;           // ... and in the next, of the square of the last turn's angle
constexpr double touching = 1e-4;        // nearer than this part of the breadth, GJK's normal is not taken
constexpr double margin_part = 0.02;     // of the breadth
constexpr double same_hill = 0.2;        // starts nearer than that to a maximum are taken to lead to it
constexpr double at_rest = 1e-6;         // turn of the normal
constexpr double flat = 1e-12;           // sine below which a simplex has no area or volume
constexpr double least_breadth = 1e-9;   // [m]

Vec3 support_of(const Core& core, const Vec3& d) noexcept {
  const auto axis = core.R.col(2);
  const double along = axis.dot(d);
  switch (core.shape) {
    case CoreShape::segment:
      return core.origin + (along < 0 ? -core.half_length : core.half_length) * axis;
    case CoreShape::cylinder: {
      const double x = core.R.col(0).dot(d), y = core.R.col(1).dot(d), length = std::sqrt(x * x + y * y);
      const Vec3 end = core.origin + (along < 0 ? -core.half_length : core.half_length) * axis;
      if (!(length > std::numeric_limits<double>::min())) return end;
      return end + core.radius / length * (x * core.R.col(0) + y * core.R.col(1));
    }
    case CoreShape::hull:
      break;
  }
  const Vec3 local = core.R.transpose() * d;
  const Vec3* best = nullptr;
  double farthest = -std::numeric_limits<double>::infinity();
  for (const Vec3& v : core.hull->vertices)
    if (const double far = v.dot(local); far > farthest) {
      farthest = far;
      best = &v;
    }
  return best ? Vec3(core.origin + core.R * *best) : core.centre;
}

// Support points of M and the weights that make v of them.
struct Simplex {
  struct Vertex {
    Vec3 y, on_a, on_b;
    double weight;
  };
  std::array<Vertex, 4> vertex;
  int count = 0;
};

struct Nearest {
  std::array<double, 4> weight;
  Vec3 v;
  double squared;
};

void keep_nearer(Nearest& best, const Nearest& other) noexcept {
  if (other.squared < best.squared) best = other;
}

void with_edge(Nearest& best, const Simplex& s, int i, int k) noexcept {
  const Vec3 &a = s.vertex[i].y, &b = s.vertex[k].y;
  const Vec3 ab = b - a;
  const double length = ab.squaredNorm();
  const double t = length > 0 ? std::clamp(-a.dot(ab) / length, 0.0, 1.0) : 0.0;
  Nearest edge{{}, t <= 0 ? a : t >= 1 ? b : Vec3(a + t * ab), 0};
  edge.weight[i] = 1 - t;
  edge.weight[k] = t;
  edge.squared = edge.v.squaredNorm();
  keep_nearer(best, edge);
}

// The origin's projection on the plane, or else the nearest point of the edges. Gram-Schmidt: the triangles
// of a rim's points are slender, and an error of the second weight is made good by the first.
void with_triangle(Nearest& best, const Simplex& s, int i, int j, int k) noexcept {
  const Vec3& a = s.vertex[i].y;
  const Vec3 ab = s.vertex[j].y - a, ac = s.vertex[k].y - a;
  const double along = ab.squaredNorm(), skew = along > 0 ? ab.dot(ac) / along : 0;
  const Vec3 height = ac - skew * ab;
  const double square = height.squaredNorm();
  const bool thin = square <= flat * flat * ac.squaredNorm() || along == 0;
  if (!thin) {
    const double wc = -a.dot(height) / square;
    const Vec3 foot = a + wc * ac;
    const double wb = -foot.dot(ab) / along, wa = 1 - wb - wc;
    if (wa > 0 && wb > 0 && wc > 0) {
      Nearest face{{}, foot + wb * ab, 0};
      face.weight[i] = wa;
      face.weight[j] = wb;
      face.weight[k] = wc;
      face.squared = face.v.squaredNorm();
      keep_nearer(best, face);
      return;
    }
  }
  with_edge(best, s, j, k);
  with_edge(best, s, k, i);
  with_edge(best, s, i, j);
}

// Nearest to the origin; false where the tetrahedron contains it.
bool nearest_of(const Simplex& s, Nearest& best) noexcept {
  best = {{1, 0, 0, 0}, s.vertex[0].y, std::numeric_limits<double>::infinity()};
  if (s.count == 1) best.squared = best.v.squaredNorm();
  if (s.count == 2) with_edge(best, s, 0, 1);
  if (s.count == 3) with_triangle(best, s, 0, 1, 2);
  if (s.count < 4) return true;
  constexpr int face[4][4] = {{0, 1, 2, 3}, {0, 1, 3, 2}, {0, 2, 3, 1}, {1, 2, 3, 0}};
  bool outside = false;
  for (const auto& f : face) {
    const Vec3 &a = s.vertex[f[0]].y, ab = s.vertex[f[1]].y - a, ac = s.vertex[f[2]].y - a,
               ad = s.vertex[f[3]].y - a, n = ab.cross(ac);
    const double volume = n.dot(ad), origin = -n.dot(a);
    const bool thin = volume * volume <= flat * flat * n.squaredNorm() * ad.squaredNorm();
    if (!thin && volume * origin >= 0) continue;
    outside = true;
    with_triangle(best, s, f[0], f[1], f[2]);
  }
  return outside;
}

void reduce(Simplex& s, const Nearest& nearest) noexcept {
  int kept = 0;
  for (int i = 0; i < s.count; ++i)
    if (nearest.weight[i] > 0) {
      s.vertex[kept] = s.vertex[i];
      s.vertex[kept++].weight = nearest.weight[i];
    }
  s.count = kept;
}

// v of b moved by `shift`, from a simplex of earlier support points, or from none. False where they overlap.
bool gjk(const Core& a, const Core& b, const Vec3& shift, double least, double tolerance, Simplex& s,
         Vec3& v) noexcept {
  Nearest nearest;
  for (int i = 0; i < s.count; ++i) s.vertex[i].y = s.vertex[i].on_b + shift - s.vertex[i].on_a;
  if (s.count > 0) {
    if (!nearest_of(s, nearest)) return false;
    reduce(s, nearest);
    v = nearest.v;
  }
  double squared = s.count > 0 ? nearest.squared : std::numeric_limits<double>::infinity();
  bool parted = false;  // a plane between them is known, whatever round-off says of a flat tetrahedron
  for (int turn = 0; turn < max_supports; ++turn) {
    if (squared <= least * least) return false;
    Simplex::Vertex w{{}, support_of(a, v), support_of(b, -v), 1};
    w.y = w.on_b + shift - w.on_a;
    if (s.count > 0) {
      parted = parted || v.dot(w.y) > 0;
      if (squared - v.dot(w.y) <= tolerance * squared) return true;
      for (int i = 0; i < s.count; ++i)
        if ((s.vertex[i].y - w.y).squaredNorm() == 0) return true;
    }
    Simplex grown = s;
    grown.vertex[grown.count++] = w;
    if (!nearest_of(grown, nearest)) return parted;
    if (nearest.squared >= squared) return true;  // round-off
    reduce(grown, nearest);
    s = grown;
    v = nearest.v;
    squared = nearest.squared;
  }
  return squared > least * least;
}

CoreGap gap_of(double distance, const Vec3& normal, const Simplex& s) noexcept {
  CoreGap gap{distance, normal, Vec3::Zero(), Vec3::Zero()};
  for (int i = 0; i < s.count; ++i) {
    gap.on_a += s.vertex[i].weight * s.vertex[i].on_a;
    gap.on_b += s.vertex[i].weight * s.vertex[i].on_b;
  }
  return gap;
}

double breadth_of(const Core& core) noexcept {
  if (core.shape == CoreShape::segment) return std::numeric_limits<double>::infinity();
  if (core.shape == CoreShape::cylinder) return std::min(core.radius, core.half_length);
  const Vec3 local = core.R.transpose() * (core.centre - core.origin);
  double least = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector4d& plane : core.hull->planes)
    least = std::min(least, -(plane.head<3>().dot(local) + plane[3]));
  return least;
}

// The best normal among some: a start.
struct Start {
  const Core &a, &b;
  Vec3 normal = Vec3::UnitZ();
  double g = -std::numeric_limits<double>::infinity();

  void consider(const Vec3& direction) noexcept {
    const double length = direction.norm();
    if (!(length > std::numeric_limits<double>::min())) return;
    const Vec3 n = direction / length;
    const double here = n.dot(support_of(b, -n) - support_of(a, n));
    if (here > g) {
      g = here;
      normal = n;
    }
  }
  void consider_core(const Core& core, double sign, const Vec3& between) noexcept {
    const Vec3 axis = core.R.col(2);
    if (core.hull) {
      for (const Eigen::Vector4d& plane : core.hull->planes) consider(sign * (core.R * plane.head<3>()));
    } else {
      consider(axis);
      consider(-axis);
      consider(between - between.dot(axis) * axis);
      consider(core.R.col(0));
    }
  }
};

// Turns n until it rests.
CoreGap least_parting(const Core& a, const Core& b, const Start& start, double breadth) noexcept {
  CoreGap best{start.g, start.normal, support_of(a, start.normal), support_of(b, -start.normal)};
  Vec3 n = start.normal;
  double tolerance = roughly_closed;
  Simplex simplex;
  for (int turn = 0; turn < max_turns; ++turn) {
    const double s = margin_part * breadth + std::max(0.0, -best.distance);
    Vec3 v = n;
    if (!gjk(a, b, s * n, 0, turn + 1 < max_turns ? tolerance : closed, simplex, v)) break;
    const double length = v.norm();
    const Vec3 m = v / length;
    const double moved = (m - n).norm();
    best = gap_of(length - s * n.dot(m), m, simplex);
    if (moved < at_rest && tolerance == closed) break;
    tolerance = std::clamp(finer * moved * moved, closed, tolerance);
    n = m;
  }
  return best;
}

}  // namespace

CoreGap core_gap(const Core& a, const Core& b) noexcept {
  const double breadth = std::max(least_breadth, std::min(breadth_of(a), breadth_of(b)));
  const Vec3 between = b.centre - a.centre;
  Simplex simplex;
  Vec3 v = between;
  if (gjk(a, b, Vec3::Zero(), touching * breadth, closed, simplex, v))
    return gap_of(v.norm(), v.normalized(), simplex);

  Start faces{a, b}, line{a, b};
  faces.consider_core(a, 1, between);
  faces.consider_core(b, -1, between);
  if (!a.hull && !b.hull) {
    const Vec3 across = a.R.col(2).cross(b.R.col(2));
    faces.consider(across);
    faces.consider(-across);
  }
  faces.consider(between);
  const CoreGap by_faces = least_parting(a, b, faces, breadth);
  for (const double part : {0.02, 0.1, 0.5}) {
    simplex.count = 0;
    v = between;
    if (!gjk(a, b, part * between, touching * breadth, roughly_closed, simplex, v)) continue;
    line.consider(v);
    if (!a.hull && !b.hull && (line.normal - by_faces.normal).norm() < same_hill &&
        line.g <= by_faces.distance)
      break;
    const CoreGap by_line = least_parting(a, b, line, breadth);
    return by_line.distance > by_faces.distance ? by_line : by_faces;
  }
  return by_faces;
}

}  // namespace hapticd
