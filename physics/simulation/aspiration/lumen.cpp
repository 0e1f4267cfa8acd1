// Lower bound: a circle around projected points has at least their mean square distance from their centroid
// as its squared radius, and that is no less than the sum of the two smaller principal variances, whatever
// the direction. It rejects pieces far too wide without a search.
#include "physics/simulation/aspiration/lumen.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace hapticd {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr int grid = 64;               // directions of a half sphere
constexpr double finest_turn = 2e-3;   // [rad]
constexpr double coarsest_turn = 0.2;  // about the grid's spacing
constexpr double slack = 1e-9;         // of a radius: a point so near outside is inside

struct Circle {
  Vec2 centre = Vec2::Zero();
  double radius = -1;
  bool holds(const Vec2& p) const { return (p - centre).norm() <= radius * (1 + slack); }
};

Circle across(const Vec2& a, const Vec2& b) { return {0.5 * (a + b), 0.5 * (a - b).norm()}; }

Circle around(const Vec2& a, const Vec2& b, const Vec2& c) {
  const Vec2 u = b - a, v = c - a;
  const double area = 2 * (u.x() * v.y() - u.y() * v.x());
  if (std::abs(area) < 1e-12 * (u.squaredNorm() + v.squaredNorm())) {
    Circle widest = across(a, b);
    for (const Circle& other : {across(b, c), across(c, a)})
      if (other.radius > widest.radius) widest = other;
    return widest;
  }
  const Vec2 from_a = Vec2(v.y() * u.squaredNorm() - u.y() * v.squaredNorm(),
                           u.x() * v.squaredNorm() - v.x() * u.squaredNorm()) /
                      area;
  return {a + from_a, from_a.norm()};
}

// Welzl's incremental construction.
double enclosing_radius(std::span<const Vec2> p) {
  Circle circle{p[0], 0};
  for (std::size_t i = 1; i < p.size(); ++i) {
    if (circle.holds(p[i])) continue;
    circle = {p[i], 0};
    for (std::size_t j = 0; j < i; ++j) {
      if (circle.holds(p[j])) continue;
      circle = across(p[i], p[j]);
      for (std::size_t k = 0; k < j; ++k)
        if (!circle.holds(p[k])) circle = around(p[i], p[j], p[k]);
    }
  }
  return circle.radius;
}

class Projection {
 public:
  explicit Projection(std::span<const Vec3> nodes) : nodes_(nodes), flat_(nodes.size()) {}

  double radius(const Vec3& along) {
    const Vec3 e = along.unitOrthogonal(), f = along.cross(e);
    for (std::size_t n = 0; n < nodes_.size(); ++n) flat_[n] = {e.dot(nodes_[n]), f.dot(nodes_[n])};
    return enclosing_radius(flat_);
  }

 private:
  std::span<const Vec3> nodes_;
  std::vector<Vec2> flat_;
};

// Of a half sphere, evenly (Fibonacci's lattice).
Vec3 direction(int i) {
  const double z = (i + 0.5) / grid, turn = i * std::numbers::pi * (3 - std::sqrt(5.0));
  const double r = std::sqrt(1 - z * z);
  return {r * std::cos(turn), r * std::sin(turn), z};
}

}  // namespace

double passing_radius(std::span<const Vec3> nodes, double enough) {
  if (nodes.empty()) return 0;
  Vec3 middle = Vec3::Zero();
  for (const Vec3& x : nodes) middle += x / static_cast<double>(nodes.size());
  Mat3 variance = Mat3::Zero();
  double sphere = 0;
  std::vector<Vec3> centred;
  for (const Vec3& x : nodes) {
    centred.push_back(x - middle);
    variance += centred.back() * centred.back().transpose() / static_cast<double>(nodes.size());
    sphere = std::max(sphere, centred.back().norm());
  }
  if (sphere <= enough) return sphere;
  const Eigen::SelfAdjointEigenSolver<Mat3> principal(variance);
  const double least = std::sqrt(std::max(0.0, principal.eigenvalues()[0] + principal.eigenvalues()[1]));
  if (enough > 0 && least > enough) return least;

  Projection projection(centred);
  Vec3 best = Vec3::UnitZ();
  double radius = std::numeric_limits<double>::infinity();
  const auto try_direction = [&](const Vec3& d) {
    const double r = projection.radius(d);
    if (r >= radius) return false;
    radius = r;
    best = d;
    return true;
  };
  for (int k = 2; k >= 0 && radius > enough; --k) try_direction(principal.eigenvectors().col(k));
  for (int i = 0; i < grid && radius > enough; ++i) try_direction(direction(i));
  for (double turn = coarsest_turn; turn > finest_turn && radius > enough;) {
    const Vec3 e = best.unitOrthogonal(), f = best.cross(e), from = best;
    bool nearer = false;
    for (const Vec3& side : {e, f, Vec3(-e), Vec3(-f)})
      nearer = try_direction((from + turn * side).normalized()) || nearer;
    if (!nearer) turn *= 0.5;
  }
  return radius;
}

double distance_to_opening(const Port& port, const Vec3& local) noexcept {
  const Vec3 from = local - port.position;
  const double along = from.dot(port.direction), radial = (from - along * port.direction).norm();
  return std::hypot(along, std::max(0.0, radial - port.radius));
}

std::vector<Vec3> nodes_of(const TissueModel& model, const TissueState& state, std::span<const int> tets) {
  std::vector<int> nodes;
  for (const int t : tets) nodes.insert(nodes.end(), model.mesh.tets[t].begin(), model.mesh.tets[t].end());
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  std::vector<Vec3> x(nodes.size());
  std::transform(nodes.begin(), nodes.end(), x.begin(), [&](int n) { return state.x[n]; });
  return x;
}

}  // namespace hapticd
