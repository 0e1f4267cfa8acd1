#include "server/observe/instrument_shape.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double on_plane = 1e-6;        // of the extent
constexpr double edge_thickness = 0.01;  // of the edge's length

enum class Record { sphere, capsule, cylinder, triangle };

void put(std::vector<float>& out, Record record) { out.push_back(static_cast<float>(record)); }
void put(std::vector<float>& out, const Vec3& v) {
  for (int i = 0; i < 3; ++i) out.push_back(static_cast<float>(v[i]));
}

void put_round(std::vector<float>& out, Record record, double radius, double half_length, const Pose& X) {
  put(out, record);
  out.push_back(static_cast<float>(radius));
  out.push_back(static_cast<float>(half_length));
  put(out, X.p);
  for (int i = 0; i < 4; ++i) out.push_back(static_cast<float>(X.q.coeffs()[i]));
}

// The corners of a face lie around it; a fan from the first of them.
void put_hull(std::vector<float>& out, const Primitive& p) {
  Eigen::AlignedBox3d box;
  for (const Vec3& v : p.vertices) box.extend(v);
  for (const Eigen::Vector4d& plane : p.planes) {
    const Vec3 n = plane.head<3>();
    std::vector<Vec3> corner;
    Vec3 middle = Vec3::Zero();
    for (const Vec3& v : p.vertices)
      if (std::abs(n.dot(v) + plane[3]) < on_plane * box.sizes().maxCoeff()) {
        corner.push_back(v);
        middle += v;
      }
    if (corner.size() < 3) continue;
    middle /= static_cast<double>(corner.size());
    const Vec3 u = (corner[0] - middle).normalized(), w = n.cross(u);
    const auto angle = [&](const Vec3& v) { return std::atan2(w.dot(v - middle), u.dot(v - middle)); };
    std::sort(corner.begin(), corner.end(),
              [&](const Vec3& a, const Vec3& b) { return angle(a) < angle(b); });
    for (std::size_t k = 2; k < corner.size(); ++k) {
      put(out, Record::triangle);
      for (const Vec3& v : {corner[0], corner[k - 1], corner[k]}) put(out, p.placement.to_world(v));
    }
  }
}

}  // namespace

std::vector<float> instrument_shape(const Instrument& instrument) {
  std::vector<float> out;
  for (const Primitive& p : instrument.primitives) {
    if (p.shape == Shape::convex)
      put_hull(out, p);
    else
      put_round(out,
                p.shape == Shape::sphere    ? Record::sphere
                : p.shape == Shape::capsule ? Record::capsule
                                            : Record::cylinder,
                p.radius, p.half_length, p.placement);
  }
  const std::vector<Vec3>& edge = instrument.blade.edge;
  double length = 0;
  for (std::size_t i = 1; i < edge.size(); ++i) length += (edge[i] - edge[i - 1]).norm();
  for (std::size_t i = 1; i < edge.size(); ++i) {
    const Vec3 along = edge[i] - edge[i - 1];
    put_round(out, Record::capsule, edge_thickness * length, 0.5 * along.norm(),
              {0.5 * (edge[i] + edge[i - 1]), Quat::FromTwoVectors(Vec3::UnitZ(), along)});
  }
  return out;
}

}  // namespace hapticd
