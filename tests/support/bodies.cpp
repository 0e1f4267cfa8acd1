#include "tests/support/bodies.h"

#include <algorithm>

#include "tests/support/mesh_shapes.h"

namespace hapticd {

Instrument ball(double radius) {
  Instrument instrument;
  Primitive tip;
  tip.shape = Shape::sphere;
  tip.radius = radius;
  instrument.primitives = {tip};
  return instrument;
}

InstrumentSample at(const Vec3& p) { return {{p, Quat::Identity()}, true, false, false}; }
InstrumentSample nobody() { return {}; }

BodySettings block(const std::string& name, const Vec3& size, const std::array<int, 3>& n,
                   const Material& material, const Pose& place) {
  BodySettings b;
  b.name = name;
  b.mesh = box_mesh(size, n[0], n[1], n[2]);
  b.material = material;
  for (Vec3& x : b.mesh.nodes) x = place.to_world(x);
  return b;
}

BodySettings slab(const std::string& name, const Vec3& size, const std::array<int, 3>& n, const Pose& place) {
  BodySettings b = block(name, size, n, {}, place);
  b.deformable = false;
  return b;
}

WorldSettings contact_world(std::vector<ContactPair> pairs) {
  WorldSettings s;
  s.h = 0.02;
  s.alarm_distance = 2e-3;
  s.sample_spacing = 1e-3;
  s.coupling[0] = {500, 0.05, 0};
  s.body_contact.pairs = std::move(pairs);
  return s;
}

double mass_of(const Body& body) {
  double sum = 0;
  for (const double m : body.state.mass) sum += m;
  return sum;
}

Vec3 centre_of(const Body& body) {
  Vec3 sum = Vec3::Zero();
  for (std::size_t n = 0; n < body.state.x.size(); ++n) sum += body.state.mass[n] * body.state.x[n];
  return sum / mass_of(body);
}

Vec3 velocity_of(const Body& body) {
  Vec3 sum = Vec3::Zero();
  for (std::size_t n = 0; n < body.state.x.size(); ++n) sum += body.state.mass[n] * body.state.v[n];
  return sum / mass_of(body);
}

double fastest_node(const Body& body) {
  double fastest = 0;
  for (const Vec3& v : body.state.v) fastest = std::max(fastest, v.norm());
  return fastest;
}

double deepest_inside(const Body& points, const Body& faces) {
  SurfaceNormals own, other;
  own.set_surface(points);
  other.set_surface(faces);
  other.follow(faces);
  double deepest = 0;
  for (const int n : own.nodes) {
    double nearest = 1e9, gap = 0;
    for (int f = 0; f < static_cast<int>(faces.surface.faces().size()); ++f) {
      const Triangle& t = faces.surface.faces()[f].nodes;
      const std::array<Vec3, 3> x = {faces.state.x[t[0]], faces.state.x[t[1]], faces.state.x[t[2]]};
      const auto w = nearest_on_triangle(points.state.x[n], x);
      const Vec3 away = points.state.x[n] - (w[0] * x[0] + w[1] * x[1] + w[2] * x[2]);
      if (away.norm() >= nearest) continue;
      nearest = away.norm();
      gap = other.feature(faces, f, w).dot(away) < 0 ? -nearest : nearest;
    }
    deepest = std::max(deepest, -gap);
  }
  return deepest;
}

}  // namespace hapticd
