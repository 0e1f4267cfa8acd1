#include "physics/simulation/collision.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#include <fcl/broadphase/broadphase_dynamic_AABB_tree.h>
#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/collision.h>
#pragma GCC diagnostic pop

namespace hapticd {
namespace {

using Hierarchy = fcl::BVHModel<fcl::AABB<double>>;
using Object = fcl::CollisionObject<double>;

// A primitive grown by the alarm distance, and where its centre sits in the primitive's frame.
struct GrownShape {
  std::shared_ptr<fcl::CollisionGeometry<double>> geometry;
  Vec3 centre = Vec3::Zero();
};

GrownShape grown(const Primitive& p, double alarm) {
  switch (p.shape) {
    case Shape::sphere:
      return {std::make_shared<fcl::Sphere<double>>(p.radius + alarm)};
    case Shape::capsule:
      return {std::make_shared<fcl::Capsule<double>>(p.radius + alarm, 2 * p.half_length)};
    case Shape::cylinder:
      return {std::make_shared<fcl::Cylinder<double>>(p.radius + alarm, 2 * (p.half_length + alarm))};
    case Shape::convex:
      break;
  }
  Eigen::AlignedBox3d box;
  for (const Vec3& v : p.vertices) box.extend(v);
  const Vec3 size = box.sizes() + Vec3::Constant(2 * alarm);
  return {std::make_shared<fcl::Box<double>>(size), box.center()};
}

constexpr double most_stretch = 1e3;  // of a face, in the body's widest at first

struct Body {
  std::vector<SurfaceFace> faces;
  double widest = 0;       // face at first [m]
  std::vector<int> nodes;  // mesh node of each hierarchy vertex
  std::shared_ptr<Hierarchy> hierarchy;
  std::unique_ptr<Object> object;
};

}  // namespace

struct Collision::Impl {
  const Instrument& instrument;
  std::vector<GrownShape> shapes;
  std::vector<Body> bodies;
  fcl::DynamicAABBTreeCollisionManager<double> manager;
  fcl::CollisionRequest<double> request;
  fcl::CollisionResult<double> result;

  explicit Impl(const Instrument& i) : instrument(i) {}
};

namespace {

// Narrow phase of one pair that the broad phase found: body hierarchy against primitive.
struct Pair {
  fcl::CollisionRequest<double>* request;
  fcl::CollisionResult<double>* result;
  std::vector<NearFace>* out;
};

bool narrow_phase(Object* a, Object* b, void* data) {
  auto& pair = *static_cast<Pair*>(data);
  Object* body = a->getNodeType() == fcl::BV_AABB ? a : b;
  Object* primitive = body == a ? b : a;
  pair.result->clear();
  fcl::collide(body, primitive, *pair.request, *pair.result);
  const int index = static_cast<int>(reinterpret_cast<std::intptr_t>(body->getUserData()));
  for (std::size_t i = 0; i < pair.result->numContacts(); ++i)
    pair.out->push_back({index, static_cast<int>(pair.result->getContact(i).b1)});
  return false;  // go on to the next pair
}

void fill_vertices(const Body& body, std::span<const Vec3> positions, std::vector<Vec3>& out) {
  out.resize(body.nodes.size());
  std::transform(body.nodes.begin(), body.nodes.end(), out.begin(), [&](int n) { return positions[n]; });
}

double width(const SurfaceFace& f, std::span<const Vec3> x) {
  const Vec3 &a = x[f.nodes[0]], &b = x[f.nodes[1]], &c = x[f.nodes[2]];
  const Eigen::Vector3d squares((b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm());
  return std::sqrt(squares.maxCoeff<Eigen::PropagateNaN>());
}

// libccd may search for ever where a face is 10^8 m wide, and near_faces with it.
void require_bounded(std::span<const SurfaceFace> faces, double widest, int index,
                     std::span<const Vec3> positions) {
  for (const SurfaceFace& f : faces)
    if (const double w = width(f, positions); !(w <= most_stretch * widest))
      throw std::runtime_error("the tissue is unstable: of body " + std::to_string(index) +
                               " the face of nodes " + std::to_string(f.nodes[0]) + ", " +
                               std::to_string(f.nodes[1]) + " and " + std::to_string(f.nodes[2]) + " is " +
                               std::to_string(w) + " m wide");
}

}  // namespace

Collision::Collision(const Instrument& instrument, double alarm_distance)
    : impl_(std::make_unique<Impl>(instrument)) {
  for (const Primitive& p : instrument.primitives) impl_->shapes.push_back(grown(p, alarm_distance));
  impl_->request.num_max_contacts = 1u << 20;
  impl_->request.enable_contact = false;
  impl_->request.gjk_solver_type = fcl::GST_LIBCCD;
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
  require_bounded(faces, body.widest, index, positions);
  if (body.object) impl_->manager.unregisterObject(body.object.get());
  body.object.reset();
  body.faces.assign(faces.begin(), faces.end());
  body.nodes.clear();
  if (faces.empty()) return;

  std::vector<int> vertex_of_node(positions.size(), -1);
  std::vector<fcl::Triangle> triangles;
  for (const SurfaceFace& f : faces) {
    std::array<std::size_t, 3> corner;
    for (int c = 0; c < 3; ++c) {
      int& vertex = vertex_of_node[f.nodes[c]];
      if (vertex < 0) {
        vertex = static_cast<int>(body.nodes.size());
        body.nodes.push_back(f.nodes[c]);
      }
      corner[c] = static_cast<std::size_t>(vertex);
    }
    triangles.emplace_back(corner[0], corner[1], corner[2]);
  }
  std::vector<Vec3> vertices;
  fill_vertices(body, positions, vertices);
  body.hierarchy = std::make_shared<Hierarchy>();
  body.hierarchy->beginModel(static_cast<int>(triangles.size()), static_cast<int>(vertices.size()));
  body.hierarchy->addSubModel(vertices, triangles);
  body.hierarchy->endModel();
  body.hierarchy->computeLocalAABB();
  body.object = std::make_unique<Object>(body.hierarchy);
  body.object->setUserData(reinterpret_cast<void*>(static_cast<std::intptr_t>(index)));
  body.object->computeAABB();
  impl_->manager.registerObject(body.object.get());
  impl_->manager.setup();
}

void Collision::refit(int index, std::span<const Vec3> positions) {
  Body& body = impl_->bodies[index];
  if (!body.object) return;
  require_bounded(body.faces, body.widest, index, positions);
  std::vector<Vec3> vertices;
  fill_vertices(body, positions, vertices);
  body.hierarchy->beginReplaceModel();
  body.hierarchy->replaceSubModel(vertices);
  body.hierarchy->endReplaceModel(true, true);
  body.hierarchy->computeLocalAABB();
  body.object->computeAABB();
  impl_->manager.update(body.object.get());
}

void Collision::near_faces(const Pose& X, std::vector<NearFace>& out) {
  out.clear();
  Pair pair{&impl_->request, &impl_->result, &out};
  for (std::size_t k = 0; k < impl_->shapes.size(); ++k) {
    const Primitive& p = impl_->instrument.primitives[k];
    const GrownShape& shape = impl_->shapes[k];
    fcl::Transform3<double> T = fcl::Transform3<double>::Identity();
    const Quat q = X.q * p.placement.q;
    T.linear() = q.toRotationMatrix();
    T.translation() = X.to_world(p.placement.to_world(shape.centre));
    Object object(shape.geometry, T);
    object.computeAABB();
    impl_->manager.collide(&object, &pair, narrow_phase);
  }
  const auto key = [](const NearFace& f) { return std::pair(f.body, f.face); };
  std::sort(out.begin(), out.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
  out.erase(
      std::unique(out.begin(), out.end(), [&](const auto& a, const auto& b) { return key(a) == key(b); }),
      out.end());
}

}  // namespace hapticd
