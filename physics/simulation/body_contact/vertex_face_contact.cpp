#include "physics/simulation/body_contact/vertex_face_contact.h"

#include <algorithm>
#include <limits>

namespace hapticd {
namespace {

constexpr double enlarged = 0.25;        // how far outside a face a projection may lie, in weights
constexpr double still_held = 0.02;      // the same for a face that held the point
constexpr double one_normal = 1 - 1e-4;  // cosine of 0.8°
constexpr double in_front = 1e-6;        // of the faces' size

struct Plane {
  Vec3 normal;
  std::array<double, 3> weight;  // of p's projection
  double gap;
};

Plane plane_of(const Vec3& p, const ContactFace& f) {
  const Vec3 u = f.x[1] - f.x[0], v = f.x[2] - f.x[0], r = p - f.x[0], area = u.cross(v);
  const double square = area.squaredNorm();
  Plane out;
  if (!(square > 0)) return {f.corner[0], {1, 0, 0}, f.corner[0].dot(r)};
  out.normal = area / std::sqrt(square);
  out.weight[1] = r.cross(v).dot(area) / square;
  out.weight[2] = u.cross(r).dot(area) / square;
  out.weight[0] = 1 - out.weight[1] - out.weight[2];
  out.gap = out.normal.dot(r);
  return out;
}

Vec3 at(const ContactFace& f, const std::array<double, 3>& w) {
  return w[0] * f.x[0] + w[1] * f.x[1] + w[2] * f.x[2];
}

// Pseudo-normal at the feature that these weights lie on; zero inside the face.
Vec3 feature_normal(const ContactFace& f, const std::array<double, 3>& w) {
  const int zeros = (w[0] == 0) + (w[1] == 0) + (w[2] == 0);
  if (zeros == 0) return Vec3::Zero();
  for (int c = 0; c < 3; ++c) {
    if (zeros == 1 && w[c] == 0) return f.edge[c];
    if (zeros == 2 && w[c] != 0) return f.corner[c];
  }
  return Vec3::Zero();
}

// Whether g lies in front of f's plane: no corner behind it, one before it.
bool lies_before(const ContactFace& g, const ContactFace& f, const Vec3& normal) {
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (const Vec3& x : g.x) {
    const double height = normal.dot(x - f.x[0]);
    least = std::min(least, height);
    most = std::max(most, height);
  }
  const double size = (g.x[1] - g.x[0]).norm() + (g.x[2] - g.x[0]).norm();
  return least > -in_front * size && most > in_front * size;
}

}  // namespace

std::array<double, 3> nearest_on_triangle(const Vec3& p, const std::array<Vec3, 3>& x) noexcept {
  const Vec3 ab = x[1] - x[0], ac = x[2] - x[0];
  const double d1 = ab.dot(p - x[0]), d2 = ac.dot(p - x[0]);
  if (d1 <= 0 && d2 <= 0) return {1, 0, 0};
  const double d3 = ab.dot(p - x[1]), d4 = ac.dot(p - x[1]);
  if (d3 >= 0 && d4 <= d3) return {0, 1, 0};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) {
    const double t = d1 - d3 > 0 ? d1 / (d1 - d3) : 0;
    return {1 - t, t, 0};
  }
  const double d5 = ab.dot(p - x[2]), d6 = ac.dot(p - x[2]);
  if (d6 >= 0 && d5 <= d6) return {0, 0, 1};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) {
    const double t = d2 - d6 > 0 ? d2 / (d2 - d6) : 0;
    return {1 - t, 0, t};
  }
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    const double t = (d4 - d3) + (d5 - d6) > 0 ? (d4 - d3) / ((d4 - d3) + (d5 - d6)) : 0;
    return {0, 1 - t, t};
  }
  const double sum = 1 / (va + vb + vc);
  return {1 - vb * sum - vc * sum, vb * sum, vc * sum};
}

int find_vertex_face_contacts(const Vec3& p, std::span<const ContactFace> faces, double same_place, int held,
                              std::array<VertexFaceContact, max_vertex_face_contacts>& out) noexcept {
  int nearest = -1;
  double least = std::numeric_limits<double>::infinity();
  std::array<double, 3> weight{};
  for (int k = 0; k < static_cast<int>(faces.size()); ++k) {
    const std::array<double, 3> w = nearest_on_triangle(p, faces[k].x);
    const double distance = (p - at(faces[k], w)).squaredNorm();
    if (!(distance < least)) continue;
    least = distance;
    nearest = k;
    weight = w;
  }
  if (nearest < 0) return 0;

  bool holds = false;
  if (held >= 0) {
    const Plane plane = plane_of(p, faces[held]);
    holds = *std::min_element(plane.weight.begin(), plane.weight.end()) > -still_held;
    if (holds) nearest = held;
  }
  const ContactFace& main = faces[nearest];
  const Plane plane = plane_of(p, main);
  out[0] = {nearest, plane.normal, plane.gap, plane.weight};
  const Vec3 pseudo = holds ? Vec3(Vec3::Zero()) : feature_normal(main, weight);
  const Vec3 away = p - at(main, weight);
  if (!pseudo.isZero(0) && pseudo.dot(away) >= 0) {
    const double distance = std::sqrt(least);
    const bool far = distance > same_place;
    out[0].normal = far ? Vec3(away / distance) : pseudo;
    out[0].gap = far ? distance : pseudo.dot(away);
    out[0].weight = weight;
  }

  int count = 1;
  // In the order of their planes' distance, by repeated search: a point has few faces.
  for (double beyond = -std::numeric_limits<double>::infinity(); count < max_vertex_face_contacts;) {
    Plane best;
    int found = -1;
    for (int k = 0; k < static_cast<int>(faces.size()); ++k) {
      if (k == nearest) continue;
      const Plane other = plane_of(p, faces[k]);
      if (!(other.gap > beyond) || (found >= 0 && !(other.gap < best.gap))) continue;
      if (*std::min_element(other.weight.begin(), other.weight.end()) < -enlarged) continue;
      if (!lies_before(faces[k], main, plane.normal) || !lies_before(main, faces[k], other.normal)) continue;
      best = other;
      found = k;
    }
    if (found < 0) break;
    beyond = best.gap;
    const bool known = best.normal.dot(plane.normal) > one_normal ||
                       std::any_of(out.begin(), out.begin() + count, [&](const VertexFaceContact& t) {
                         return t.normal.dot(best.normal) > one_normal;
                       });
    if (!known) out[count++] = {found, best.normal, best.gap, best.weight};
  }
  return count;
}

}  // namespace hapticd
