// Convex hull of a few dozen points, at start-up: every triple that has all points on one side of its
// plane spans a face. O(n⁴), but nothing in it can go wrong by an ordering of the points.
#include <algorithm>
#include <stdexcept>

#include "physics/contact/instrument.h"

namespace hapticd {
namespace {

constexpr double same_place = 1e-9;  // of the points' extent
constexpr double least_area = 1e-6;  // of the extent's square: a thinner triple has no reliable normal
constexpr double same_normal = 1e-6;

struct Face {
  Eigen::Vector4d plane;
  double area;  // of the triple that spans it: the largest one has the best normal
};

std::vector<Vec3> without_duplicates(const std::vector<Vec3>& points, double tolerance) {
  std::vector<Vec3> out;
  for (const Vec3& p : points)
    if (std::none_of(out.begin(), out.end(), [&](const Vec3& o) { return (o - p).norm() <= tolerance; }))
      out.push_back(p);
  return out;
}

void add_face(std::vector<Face>& faces, const Face& face, double extent) {
  for (Face& f : faces) {
    const bool same = (f.plane.head<3>() - face.plane.head<3>()).norm() < same_normal &&
                      std::abs(f.plane[3] - face.plane[3]) < same_normal * extent;
    if (!same) continue;
    if (face.area > f.area) f = face;
    return;
  }
  faces.push_back(face);
}

std::vector<Face> hull_faces(const std::vector<Vec3>& p, const Vec3& centre, double extent) {
  std::vector<Face> faces;
  for (std::size_t i = 0; i < p.size(); ++i)
    for (std::size_t j = i + 1; j < p.size(); ++j)
      for (std::size_t k = j + 1; k < p.size(); ++k) {
        Vec3 n = (p[j] - p[i]).cross(p[k] - p[i]);
        const double area = n.norm();
        if (area < least_area * extent * extent) continue;
        n /= area;
        if (n.dot(p[i] - centre) < 0) n = -n;
        const double d = -n.dot(p[i]);
        const bool outermost = std::all_of(
            p.begin(), p.end(), [&](const Vec3& x) { return n.dot(x) + d <= same_place * extent; });
        if (outermost) add_face(faces, {{n.x(), n.y(), n.z(), d}, area}, extent);
      }
  return faces;
}

// A point is a vertex of the hull where the normals of the faces through it span space.
bool is_vertex(const Vec3& x, const std::vector<Face>& faces, double extent) {
  Mat3 normals = Mat3::Zero();
  for (const Face& f : faces) {
    const Vec3 n = f.plane.head<3>();
    if (std::abs(n.dot(x) + f.plane[3]) <= 10 * same_place * extent) normals += n * n.transpose();
  }
  return normals.determinant() > 1e-12;
}

}  // namespace

Primitive make_convex(std::string name, const std::vector<Vec3>& points, const Pose& placement) {
  Eigen::AlignedBox3d box;
  Vec3 centre = Vec3::Zero();
  for (const Vec3& p : points) {
    if (!p.allFinite()) throw std::invalid_argument("convex '" + name + "': a point is not finite");
    box.extend(p);
    centre += p / static_cast<double>(points.size());
  }
  const double extent = points.empty() ? 0 : box.sizes().maxCoeff();
  const std::vector<Vec3> distinct = without_duplicates(points, same_place * extent);
  const std::vector<Face> faces = hull_faces(distinct, centre, extent);

  Primitive out;
  out.name = std::move(name);
  out.shape = Shape::convex;
  out.placement = placement;
  for (const Face& f : faces) out.planes.push_back(f.plane);
  for (const Vec3& p : distinct)
    if (is_vertex(p, faces, extent)) out.vertices.push_back(p);
  // Flat points give two opposite faces and no vertex; a volume has four of each at least.
  if (out.planes.size() < 4 || out.vertices.size() < 4)
    throw std::invalid_argument("convex '" + out.name + "': its points span no volume");
  return out;
}

}  // namespace hapticd
