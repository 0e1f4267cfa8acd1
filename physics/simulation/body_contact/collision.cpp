#include "physics/simulation/body_contact/collision.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/geometry/shape/utility.h>
#include <fcl/narrowphase/detail/gjk_solver_libccd.h>
#pragma GCC diagnostic pop

namespace hapticd {
namespace {

using Transform = fcl::Transform3<double>;
using Box = fcl::AABB<double>;

// A primitive grown by the alarm distance, and where its centre sits in the instrument's frame.
struct GrownShape {
  int instrument = 0;
  Pose placement;
  Vec3 centre = Vec3::Zero();
  Vec3 half = Vec3::Zero();  // of its box in its own axes: a slanting shaft has a wide one in the world's
  std::function<Box(const Transform&)> box;
  std::function<bool(const Vec3&)> holds;  // a point in its own axes
  std::function<bool(const Transform&, const std::array<Vec3, 3>& face)> touches;
};

bool is_inside(const fcl::Sphere<double>& s, const Vec3& p) { return p.squaredNorm() < s.radius * s.radius; }
bool is_inside(const fcl::Capsule<double>& s, const Vec3& p) {
  const double beyond = std::max(0.0, std::abs(p.z()) - 0.5 * s.lz);
  return p.head<2>().squaredNorm() + beyond * beyond < s.radius * s.radius;
}
bool is_inside(const fcl::Cylinder<double>& s, const Vec3& p) {
  return std::abs(p.z()) < 0.5 * s.lz && p.head<2>().squaredNorm() < s.radius * s.radius;
}
bool is_inside(const fcl::Box<double>& s, const Vec3& p) {
  return ((2 * p.cwiseAbs() - s.side).array() < 0).all();
}

template <class Shape>
GrownShape grown(const Shape& shape, const Vec3& centre = Vec3::Zero()) {
  const auto box = [shape](const Transform& T) {
    Box of;
    fcl::computeBV(shape, T, of);
    return of;
  };
  const auto touches = [shape](const Transform& T, const std::array<Vec3, 3>& face) {
    return fcl::detail::GJKSolver_libccd<double>().shapeTriangleIntersect(shape, T, face[0], face[1],
                                                                          face[2]);
  };
  Box own;
  fcl::computeBV(shape, Transform(Transform::Identity()), own);
  const auto holds = [shape](const Vec3& p) { return is_inside(shape, p); };
  return {0, {}, centre, 0.5 * (own.max_ - own.min_), box, holds, touches};
}

GrownShape grown(const Primitive& p, double margin) {
  switch (p.shape) {
    case Shape::sphere:
      return grown(fcl::Sphere<double>(p.radius + margin));
    case Shape::capsule:
      return grown(fcl::Capsule<double>(p.radius + margin, 2 * p.half_length));
    case Shape::cylinder:
      return grown(fcl::Cylinder<double>(p.radius + margin, 2 * (p.half_length + margin)));
    case Shape::convex:
      break;
  }
  Eigen::AlignedBox3d box;
  for (const Vec3& v : p.vertices) box.extend(v);
  const Vec3 size = box.sizes() + Vec3::Constant(2 * margin);
  return grown(fcl::Box<double>(size), box.center());
}

constexpr double most_stretch = 1e3;  // of a face, in the body's widest at first

struct Ball {
  Vec3 centre;
  double radius;
};

struct Body {
  std::vector<SurfaceFace> faces;
  double widest = 0;                         // face at first [m]
  Box box;                                   // of all faces
  std::vector<std::array<Vec3, 3>> corners;  // of each face
  std::vector<Box> boxes;
  std::vector<Ball> balls;
};

}  // namespace

struct Collision::Impl {
  std::vector<GrownShape> shapes;
  std::vector<Body> bodies;
};

namespace {

double width(const SurfaceFace& f, std::span<const Vec3> x) {
  const Vec3 &a = x[f.nodes[0]], &b = x[f.nodes[1]], &c = x[f.nodes[2]];
  const Eigen::Vector3d squares((b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm());
  return std::sqrt(squares.maxCoeff<Eigen::PropagateNaN>());
}

// libccd may search for ever where a face is 10^8 m wide, and near_faces with it.
void require_bounded(const SurfaceFace& f, double widest, int index, std::span<const Vec3> positions) {
  if (const double w = width(f, positions); !(w <= most_stretch * widest))
    throw std::runtime_error("the tissue is unstable: of body " + std::to_string(index) +
                             " the face of nodes " + std::to_string(f.nodes[0]) + ", " +
                             std::to_string(f.nodes[1]) + " and " + std::to_string(f.nodes[2]) + " is " +
                             std::to_string(w) + " m wide");
}

void find_box(Body& body, std::size_t f, std::span<const Vec3> positions) {
  const auto [a, b, c] = body.faces[f].nodes;
  body.corners[f] = {positions[a], positions[b], positions[c]};
  body.boxes[f] = Box(positions[a], positions[b], positions[c]);
  const Vec3 centre = (positions[a] + positions[b] + positions[c]) / 3;
  double square = 0;
  for (const Vec3& corner : body.corners[f]) square = std::max(square, (corner - centre).squaredNorm());
  body.balls[f] = {centre, std::sqrt(square)};
}

void find_whole_box(Body& body) {
  body.box = Box();
  for (const Box& of_face : body.boxes) body.box += of_face;
}

}  // namespace

Collision::Collision(Instruments instruments, double alarm_distance) : impl_(new Impl) {
  for (int i = 0; i < instruments.count(); ++i)
    for (const Primitive& p : instruments[i].primitives) {
      impl_->shapes.push_back(grown(p, alarm_distance));
      impl_->shapes.back().instrument = i;
      impl_->shapes.back().placement = p.placement;
    }
}

Collision::~Collision() = default;

int Collision::add_body(std::span<const SurfaceFace> faces, std::span<const Vec3> positions) {
  impl_->bodies.emplace_back();
  const int body = static_cast<int>(impl_->bodies.size()) - 1;
  for (const SurfaceFace& f : faces)
    impl_->bodies[body].widest = std::max(impl_->bodies[body].widest, width(f, positions));
  set_surface(body, faces, positions);
  return body;
}

void Collision::set_surface(int index, std::span<const SurfaceFace> faces, std::span<const Vec3> positions) {
  Body& body = impl_->bodies[index];
  for (const SurfaceFace& f : faces) require_bounded(f, body.widest, index, positions);
  body.faces.assign(faces.begin(), faces.end());
  body.corners.resize(body.faces.size());
  body.boxes.resize(body.faces.size());
  body.balls.resize(body.faces.size());
  for (std::size_t f = 0; f < body.faces.size(); ++f) find_box(body, f, positions);
  find_whole_box(body);
}

void Collision::refit(int index, std::span<const Vec3> positions) {
  Body& body = impl_->bodies[index];
  for (std::size_t f = 0; f < body.faces.size(); ++f) {
    const auto [a, b, c] = body.faces[f].nodes;
    if (body.corners[f] == std::array<Vec3, 3>{positions[a], positions[b], positions[c]}) continue;
    require_bounded(body.faces[f], body.widest, index, positions);
    find_box(body, f, positions);
  }
  find_whole_box(body);
}

void Collision::near_faces(const InstrumentPoses& poses, std::vector<NearFace>& out) {
  out.clear();
  for (const GrownShape& shape : impl_->shapes) {
    if (!poses.present[shape.instrument]) continue;
    const Pose& X = poses[shape.instrument];
    Transform T = Transform::Identity();
    T.linear() = (X.q * shape.placement.q).toRotationMatrix();
    T.translation() = X.to_world(shape.placement.to_world(shape.centre));
    const Box box = shape.box(T);
    const Mat3 own_axes = T.linear().transpose();
    const auto may_touch = [&](const Ball& ball) {
      const Vec3 beyond = (own_axes * (ball.centre - T.translation())).cwiseAbs() - shape.half;
      return beyond.maxCoeff() <= (1 + 1e-6) * ball.radius;
    };
    // Most of those near have a corner inside, and need no search.
    const auto touches = [&](const std::array<Vec3, 3>& face) {
      return std::any_of(face.begin(), face.end(),
                         [&](const Vec3& x) { return shape.holds(own_axes * (x - T.translation())); }) ||
             shape.touches(T, face);
    };
    for (std::size_t b = 0; b < impl_->bodies.size(); ++b) {
      const Body& body = impl_->bodies[b];
      if (!body.box.overlap(box)) continue;
      for (std::size_t f = 0; f < body.boxes.size(); ++f)
        if (body.boxes[f].overlap(box) && may_touch(body.balls[f]) && touches(body.corners[f]))
          out.push_back({static_cast<int>(b), static_cast<int>(f)});
    }
  }
  const auto key = [](const NearFace& f) { return std::pair(f.body, f.face); };
  std::sort(out.begin(), out.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
  out.erase(
      std::unique(out.begin(), out.end(), [&](const auto& a, const auto& b) { return key(a) == key(b); }),
      out.end());
}

}  // namespace hapticd
