#include "physics/simulation/cutting/material_point.h"

#include <algorithm>

#include "physics/tissue/surface.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

constexpr int most_crossings = 4096;
constexpr double rounding = 1e-12;  // of a weight
constexpr double grazing = 0.3;     // part of a way that may point out of a face along which it then slides

std::array<double, 4> weights_at(const TissueModel& model, int tet, const Vec3& rest) noexcept {
  const Vec3 from = rest - model.mesh.nodes[model.mesh.tets[tet][0]];
  std::array<double, 4> w;
  for (int a = 0; a < 4; ++a) w[a] = (a == 0 ? 1.0 : 0.0) + model.gradients[tet].col(a).dot(from);
  return w;
}

int live_neighbour(const TissueModel& model, const TissueState& state, int face) noexcept {
  const int across = model.across[face];
  return across >= 0 && state.alive[across / 4] ? across : -1;
}

// On its tetrahedron's nearest point, roughly: weights below zero are cut off.
void pull_inside(const TissueModel& model, MaterialPoint& point) noexcept {
  double sum = 0;
  for (double& w : point.weight) sum += w = std::max(w, 0.0);
  for (double& w : point.weight) w /= sum;
  point.rest = place_of(model, model.mesh.nodes, point);
}

}  // namespace

MaterialPoint point_in(const TissueModel& model, int tet, const Vec3& rest) noexcept {
  return {tet, weights_at(model, tet, rest), rest};
}

MaterialPoint point_at(const TissueModel& model, int tet, const std::vector<Vec3>& x,
                       const Vec3& place) noexcept {
  const Tet& t = model.mesh.tets[tet];
  const Mat3 F = deformation_gradient(corners_of(t, x), model.gradients[tet]);
  if (!(F.determinant() > 0)) return {};
  const MaterialPoint point = point_in(model, tet, model.mesh.nodes[t[0]] + F.inverse() * (place - x[t[0]]));
  return *std::min_element(point.weight.begin(), point.weight.end()) >= -rounding ? point : MaterialPoint{};
}

Vec3 place_of(const TissueModel& model, const std::vector<Vec3>& x, const MaterialPoint& point) noexcept {
  Vec3 at = Vec3::Zero();
  for (int a = 0; a < 4; ++a) at += point.weight[a] * x[model.mesh.tets[point.tet][a]];
  return at;
}

Mat3 deformation_at(const TissueModel& model, const std::vector<Vec3>& x,
                    const MaterialPoint& point) noexcept {
  return deformation_gradient(corners_of(model.mesh.tets[point.tet], x), model.gradients[point.tet]);
}

double walk(const TissueModel& model, const TissueState& state, MaterialPoint& point,
            const Vec3& way) noexcept {
  Vec3 left = way;  // to go
  int came_through = -1;
  for (int crossing = 0; crossing < most_crossings; ++crossing) {
    double part = 1;
    int face = -1;
    for (int a = 0; a < 4; ++a) {
      const double falls = -model.gradients[point.tet].col(a).dot(left);
      if (falls <= 0 || 4 * point.tet + a == came_through) continue;
      const double at = std::max(point.weight[a], 0.0) / falls;
      if (at < part) {
        part = at;
        face = 4 * point.tet + a;
      }
    }
    point = point_in(model, point.tet, point.rest + part * left);
    left *= 1 - part;
    if (face < 0) return 1;
    came_through = live_neighbour(model, state, face);
    if (came_through >= 0) {
      point = point_in(model, came_through / 4, point.rest);
      continue;
    }
    pull_inside(model, point);
    const Vec3 inward = model.gradients[point.tet].col(face % 4).normalized();
    const double out = -inward.dot(left);
    if (out > grazing * left.norm()) break;
    left += out * inward;  // along the face
    came_through = face;
  }
  return way.isZero(0) ? 1 : std::max(0.0, 1 - left.norm() / way.norm());
}

void follow_cut(const TissueModel& model, const TissueState& state, MaterialPoint& point) noexcept {
  if (!point.any()) return;
  if (!state.alive[point.tet]) {
    point.tet = -1;
    return;
  }
  for (int crossing = 0; crossing < most_crossings; ++crossing) {
    point.weight = weights_at(model, point.tet, point.rest);
    const int least =
        static_cast<int>(std::min_element(point.weight.begin(), point.weight.end()) - point.weight.begin());
    if (point.weight[least] >= -rounding) return;
    const int next = live_neighbour(model, state, 4 * point.tet + least);
    if (next < 0) break;
    point.tet = next / 4;
  }
  pull_inside(model, point);
}

std::optional<SurfaceHit> first_entry(const TissueModel& model, const TissueState& state,
                                      const BoundarySurface& surface, const Vec3& p, const Vec3& way) {
  std::optional<SurfaceHit> found;
  for (const SurfaceFace& face : surface.faces()) {
    const Vec3& a = state.x[face.nodes[0]];
    const Vec3 u = state.x[face.nodes[1]] - a, v = state.x[face.nodes[2]] - a, n = u.cross(v);
    const double against = -n.dot(way);
    if (against <= 0) continue;
    const double part = n.dot(p - a) / against;
    if (part < 0 || part > 1 || (found && part >= found->part)) continue;
    const Vec3 r = p + part * way - a;
    const double area = n.squaredNorm(), beta = r.cross(v).dot(n) / area, gamma = u.cross(r).dot(n) / area;
    if (beta < 0 || gamma < 0 || beta + gamma > 1) continue;
    MaterialPoint point;
    point.tet = face.id / 4;
    const std::array<double, 3> w = {1 - beta - gamma, beta, gamma};
    const Tet& tet = model.mesh.tets[point.tet];
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 4; ++k)
        if (tet[k] == face.nodes[c]) point.weight[k] = w[c];
    point.rest = place_of(model, model.mesh.nodes, point);
    found = SurfaceHit{point, part};
  }
  return found;
}

}  // namespace hapticd
