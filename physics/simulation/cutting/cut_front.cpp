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

void CutFronts::forget() {
  for (CutFront& f : front_) give_up(f);
}

void CutFronts::find(const Bodies& bodies, const Blade& blade, const Pose& X, double reach) {
  if (blade.sample.empty()) return;
  const Vec3 d = X.q * blade.direction;
  along_ = (X.q * (blade.edge.back() - blade.edge.front())).stableNormalized();
  for (std::size_t k = 0; k < front_.size(); ++k) {
    CutFront& front = front_[k];
    const Vec3 edge = X.to_world(blade.sample[k].place);
    if (front.in_tissue) {
      const Body& body = bodies[front.body];
      const Vec3 ahead = front.point.any() ? Vec3(place_of(body.model, body.state.x, front.point) - edge)
                                           : Vec3(Vec3::Zero());
      const double aside = (ahead - d.dot(ahead) * d).norm();
      if (front.point.any() && !front.left && aside < 2 * blade.sample[k].width) continue;
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
    }
  }
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
