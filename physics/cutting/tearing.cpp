#include "physics/cutting/tearing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include <Eigen/SVD>

#include "physics/tissue/configurational_force.h"

namespace hapticd {
namespace {

constexpr double least_held =
    0.05;  // part of the held directions that must lie along an edge to be told by it
constexpr double least_angle = 5.2;  // of the tissue about a front edge [rad]; 2π is a closed slit

int corner_of(const Tet& tet, int node) noexcept {
  return static_cast<int>(std::find(tet.begin(), tet.end(), node) - tet.begin());
}

// The unit direction from the edge into a triangle with third corner c, perpendicular to the edge.
Vec3 away(const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 e = (b - a).normalized();
  const Vec3 d = c - a;
  return (d - e.dot(d) * e).normalized();
}

// From the boundary face `id` about its edge (a, b) to the other boundary face, through shared faces.
struct Fan {
  std::vector<int> tets;
  std::vector<int> faces;       // inner, between tets[k] and tets[k+1]
  std::vector<int> third;       // node of each inner face that is not of the edge
  int first_third, last_third;  // … of the two boundary faces
  double angle = 0;
};

Fan fan_about(const TissueModel& model, const TissueState& state, int id, int a, int b) {
  const auto& X = model.mesh.nodes;
  Fan fan;
  int tet = id / 4, entered = id % 4;  // the corner opposite to the face that was come through
  for (;;) {
    const Tet& t = model.mesh.tets[tet];
    const int ia = corner_of(t, a), ib = corner_of(t, b);
    // The other face at the edge lies opposite to the corner that is neither a, b nor `entered`.
    const int leaves = 6 - ia - ib - entered;
    const int before = t[leaves], after = t[entered];  // third nodes of the entered and of the left face
    if (fan.tets.empty()) fan.first_third = before;
    fan.tets.push_back(tet);
    fan.angle +=
        std::acos(std::clamp(away(X[a], X[b], X[before]).dot(away(X[a], X[b], X[after])), -1.0, 1.0));
    fan.last_third = after;
    const int across = model.across[4 * tet + leaves];
    if (across < 0 || !state.alive[across / 4] || across / 4 == id / 4) return fan;
    fan.faces.push_back(4 * tet + leaves);
    fan.third.push_back(after);
    tet = across / 4;
    entered = across % 4;
  }
}

// A node of the first mesh's boundary moves along it: out of it, the body's shape would change.
class OuterNormals {
 public:
  OuterNormals(const TissueModel& model, const BoundarySurface& surface)
      : count_(model.node_count(), 0), of_(count_.size()) {
    const auto& X = model.mesh.nodes;
    for (const SurfaceFace& f : surface.faces()) {
      if (f.cut) continue;
      const Vec3 normal = (X[f.nodes[1]] - X[f.nodes[0]]).cross(X[f.nodes[2]] - X[f.nodes[0]]).normalized();
      for (const int n : f.nodes) {
        const Vec3 rest = along(n, normal);
        if (rest.norm() < least_turn || count_[n] == 3) continue;
        of_[n][count_[n]++] = rest.normalized();
      }
    }
  }

  Mat3 normals(int node) const {
    Mat3 sum = Mat3::Zero();
    for (int k = 0; k < count_[node]; ++k) sum += of_[node][k] * of_[node][k].transpose();
    return sum;
  }

  Vec3 along(int node, Vec3 v) const {
    for (int k = 0; k < count_[node]; ++k) v -= of_[node][k].dot(v) * of_[node][k];
    return v;
  }

 private:
  static constexpr double least_turn =
      0.4;  // of a face's normal from those before it, else it is the same side
  std::vector<std::uint8_t> count_;
  std::vector<std::array<Vec3, 3>> of_;  // orthonormal
};

// The rotation nearest to the mean of these tetrahedra's.
Mat3 turn_about(const TissueState& state, const std::vector<int>& tets) {
  Mat3 sum = Mat3::Zero();
  for (const int t : tets) sum += state.rotation[t];
  const Eigen::JacobiSVD<Mat3> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  return svd.matrixU() * Vec3(1, 1, sign).asDiagonal() * svd.matrixV().transpose();
}

}  // namespace

std::vector<FrontEdge> crack_fronts(const TissueModel& model, const TissueState& state,
                                    const BoundarySurface& surface, double radius) {
  const auto& X = model.mesh.nodes;
  std::vector<FrontEdge> fronts;
  std::vector<Fan> fans;
  for (const SurfaceFace& face : surface.faces())
    for (int k = 0; k < 3; ++k) {
      const int a = face.nodes[k], b = face.nodes[(k + 1) % 3];
      if (a > b) continue;  // the face on the other side has it the other way round
      Fan fan = fan_about(model, state, face.id, a, b);
      if (fan.angle < least_angle || fan.faces.empty()) continue;
      fronts.push_back({a, b, fan.tets, -1, 0});
      fans.push_back(std::move(fan));
    }
  if (fronts.empty()) return fronts;

  const ConfigurationalForces G = configurational_forces(model, state);
  const OuterNormals outer(model, surface);
  for (std::size_t i = 0; i < fronts.size(); ++i) {
    FrontEdge& f = fronts[i];
    const Vec3 middle = 0.5 * (X[f.a] + X[f.b]);
    const auto q = [&](int n) { return std::max(0.0, 1 - (X[n] - middle).norm() / radius); };
    const Mat3 Q = turn_about(state, f.fan);
    Vec3 drive = Vec3::Zero();
    Mat3 held = Mat3::Zero();  // Σ q n nᵀ of the directions that are left out
    for (int n = 0; n < model.nodes_in_use; ++n) {
      const double weight = q(n);
      if (!(weight > 0)) continue;
      drive += weight * outer.along(n, G.at(n, Q));
      held += weight * outer.normals(n);
    }
    // Moving a front along itself releases nothing: that tells what was left out.
    const Vec3 e = (X[f.b] - X[f.a]).normalized();
    if (const double known = e.dot(held * e); known > least_held * held.trace())
      drive -= drive.dot(e) / known * (held * e);
    double length = 0;
    for (const FrontEdge& g : fronts) length += 0.5 * (q(g.a) + q(g.b)) * (X[g.b] - X[g.a]).norm();
    // Back into the slit releases nothing: ahead is half the circle.
    const Fan& fan = fans[i];
    const Vec3 back = away(X[f.a], X[f.b], X[fan.first_third]) + away(X[f.a], X[f.b], X[fan.last_third]);
    for (std::size_t k = 0; k < fan.faces.size(); ++k) {
      const Vec3 d = away(X[f.a], X[f.b], X[fan.third[k]]);
      const double release = d.dot(drive) / length;
      if (d.dot(back) > 0 || !(release > f.release)) continue;
      f.release = release;
      f.face = fan.faces[k];
    }
  }
  return fronts;
}

std::vector<int> faces_that_tear(const TissueModel& model, const TissueState& state,
                                 const BoundarySurface& surface, const TearSettings& settings) {
  std::vector<int> faces;
  if (!(settings.toughness > 0 && settings.radius > 0)) return faces;
  std::vector<FrontEdge> fronts = crack_fronts(model, state, surface, settings.radius);
  std::sort(fronts.begin(), fronts.end(), [](const FrontEdge& l, const FrontEdge& r) {
    return l.release != r.release ? l.release > r.release : std::pair(l.a, l.b) < std::pair(r.a, r.b);
  });
  for (const FrontEdge& f : fronts) {
    if (f.face < 0 || !(f.release > settings.toughness) || static_cast<int>(faces.size()) >= settings.most)
      break;
    const int other = model.across[f.face];
    if (std::find(faces.begin(), faces.end(), f.face) == faces.end() &&
        std::find(faces.begin(), faces.end(), other) == faces.end())
      faces.push_back(f.face);
  }
  return faces;
}

}  // namespace hapticd
