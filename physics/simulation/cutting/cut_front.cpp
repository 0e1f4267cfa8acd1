#include "physics/simulation/cutting/cut_front.h"

#include <algorithm>
#include <optional>

namespace hapticd {

void CutFronts::give_up(CutFront& front) {
  if (front.in_tissue) ++front.number;
  front.body = -1;
  front.in_tissue = front.begun = front.left = false;
  front.advance = 0;
}

bool CutFronts::stays(const Bodies& bodies, const CutFront& front, double width, const Vec3& edge,
                      const Vec3& d, double reach) const {
  if (!front.point.any() || front.left) return false;
  const Body& body = bodies[front.body];
  const Vec3 ahead = place_of(body.model, body.state.x, front.point) - edge;
  const double along = d.dot(ahead);
  return (ahead - along * d).norm() < 2 * width && (!rested_ || along > -reach);
}

void CutFronts::find(const Bodies& bodies, const Blade& blade, const Pose& X, double reach) {
  if (blade.sample.empty()) return;
  const Vec3 d = X.q * blade.direction;
  along_ = (X.q * (blade.edge.back() - blade.edge.front())).stableNormalized();
  for (std::size_t k = 0; k < front_.size(); ++k) {
    CutFront& front = front_[k];
    const Vec3 edge = X.to_world(blade.sample[k].place);
    if (front.in_tissue) {
      if (stays(bodies, front, blade.sample[k].width, edge, d, reach)) continue;
      front.burst = front.left;
      give_up(front);
    }
    front.body = -1;
    double nearest = 2;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      const Body& body = bodies[b];
      if (!(body.toughness > 0)) continue;
      const auto hit = first_entry(body.model, body.state, body.surface, edge - reach * d, 2 * reach * d);
      if (!hit || hit->part >= nearest) continue;
      nearest = hit->part;
      front.body = static_cast<int>(b);
      front.point = hit->point;
      front.cut_to = hit->point.rest;
      front.burst = false;
    }
  }
  rested_ = false;
  find_inside(bodies, blade, X);
}

// One pass over a body's tetrahedra for all samples that have no front.
void CutFronts::find_inside(const Bodies& bodies, const Blade& blade, const Pose& X) {
  Eigen::AlignedBox3d edge;
  std::vector<std::uint8_t> outside(front_.size(), 1);
  for (std::size_t k = 0; k < front_.size(); ++k)
    if (front_[k].body < 0) edge.extend(X.to_world(blade.sample[k].place));
  if (edge.isEmpty()) return;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const Body& body = bodies[b];
    if (!(body.toughness > 0)) continue;
    for (int t = 0; t < body.model.tets_in_use; ++t) {
      if (!body.state.alive[t]) continue;
      Eigen::AlignedBox3d box;
      for (const int n : body.model.mesh.tets[t]) box.extend(body.state.x[n]);
      if (!box.intersects(edge)) continue;
      for (std::size_t k = 0; k < front_.size(); ++k) {
        CutFront& front = front_[k];
        if (front.body >= 0) continue;
        const MaterialPoint point = point_at(body.model, t, body.state.x, X.to_world(blade.sample[k].place));
        if (!point.any()) continue;
        outside[k] = 0;
        if (front.burst) continue;
        front.body = static_cast<int>(b);
        front.point = point;
        front.cut_to = point.rest;
        front.in_tissue = true;
      }
    }
  }
  for (std::size_t k = 0; k < front_.size(); ++k)
    if (outside[k]) front_[k].burst = false;
}

double CutFronts::advance(const Bodies& bodies, int k, const Vec3& d, double by) {
  CutFront& front = front_[k];
  if (front.body < 0 || !front.point.any() || !(by > 0)) return 0;
  const Body& body = bodies[front.body];
  const Mat3 F = deformation_at(body.model, body.state.x, front.point);
  // A tetrahedron that is flat or inside out says nothing of where d leads in the rest shape.
  if (!(F.determinant() > 0.05)) return 0;
  front.in_tissue = true;
  front.advance += by;
  const Vec3 way = F.inverse() * (by * d);
  const double part = walk(body.model, body.state, front.point, way);
  front.left = part < 1;
  return part * way.norm();
}

void CutFronts::follow(const Bodies& bodies, int b) {
  for (CutFront& front : front_)
    if (front.body == b) follow_cut(bodies[b].model, bodies[b].state, front.point);
}

}  // namespace hapticd
