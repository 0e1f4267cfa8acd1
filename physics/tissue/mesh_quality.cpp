#include "physics/tissue/mesh_quality.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <set>

#include "physics/tissue/surface.h"

namespace hapticd {
namespace {

constexpr double sliver = 0.1;

using Edge = std::pair<int, int>;
Edge edge_of(int a, int b) { return {std::min(a, b), std::max(a, b)}; }

class Tally {
 public:
  void add(double x) {
    span_.least = count_ == 0 ? x : std::min(span_.least, x);
    span_.greatest = count_ == 0 ? x : std::max(span_.greatest, x);
    sum_ += x;
    ++count_;
  }
  Span span() const { return {span_.least, count_ > 0 ? sum_ / count_ : 0, span_.greatest}; }

 private:
  Span span_;
  double sum_ = 0;
  int count_ = 0;
};

std::vector<int> roots(int count, const std::vector<Edge>& joined) {
  std::vector<int> parent(count);
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](int n) {
    while (parent[n] != n) n = parent[n] = parent[parent[n]];
    return n;
  };
  for (const auto& [a, b] : joined) parent[root(b)] = root(a);
  for (int n = 0; n < count; ++n) parent[n] = root(n);
  return parent;
}

// Angles between the faces that meet in each of the six edges.
void add_dihedrals(const std::array<Vec3, 4>& x, Tally& tally) {
  std::array<Vec3, 4> normal;
  for (int f = 0; f < 4; ++f) {
    const Triangle t = outward_face({0, 1, 2, 3}, f);
    normal[f] = (x[t[1]] - x[t[0]]).cross(x[t[2]] - x[t[0]]).normalized();
  }
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < a; ++b)
      tally.add(180 / std::numbers::pi * std::acos(std::clamp(-normal[a].dot(normal[b]), -1.0, 1.0)));
}

void measure_boundary(const TetMesh& mesh, MeshQuality& q) {
  const BoundarySurface surface(mesh);
  std::map<Edge, int> faces_of_edge;
  std::vector<Edge> joined;
  std::set<int> nodes;
  for (const SurfaceFace& face : surface.faces()) {
    const Triangle& t = face.nodes;
    q.boundary_area +=
        0.5 * (mesh.nodes[t[1]] - mesh.nodes[t[0]]).cross(mesh.nodes[t[2]] - mesh.nodes[t[0]]).norm();
    for (int c = 0; c < 3; ++c) {
      ++faces_of_edge[edge_of(t[c], t[(c + 1) % 3])];
      joined.push_back({t[c], t[(c + 1) % 3]});
      nodes.insert(t[c]);
    }
  }
  q.boundary_faces = static_cast<int>(surface.faces().size());
  q.boundary_nodes = static_cast<int>(nodes.size());
  Tally length;
  for (const auto& [edge, faces] : faces_of_edge) {
    length.add((mesh.nodes[edge.first] - mesh.nodes[edge.second]).norm());
    q.open_edges += faces != 2;
  }
  q.surface_edge = length.span();
  const std::vector<int> root = roots(static_cast<int>(mesh.nodes.size()), joined);
  std::set<int> shells;
  for (const int n : nodes) shells.insert(root[n]);
  q.shells = static_cast<int>(shells.size());
}

}  // namespace

// Faces with normals n (twice the area) meet in an edge of length l at sin θ = 6 V l / (|n_k| |n_l|).
double dihedral_quality(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) noexcept {
  const std::array<const Vec3*, 4> x = {&a, &b, &c, &d};
  std::array<double, 4> normal;
  for (int f = 0; f < 4; ++f) {
    const Triangle t = outward_face({0, 1, 2, 3}, f);
    normal[f] = (*x[t[1]] - *x[t[0]]).cross(*x[t[2]] - *x[t[0]]).norm();
  }
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 4; ++i)
    for (int j = i + 1; j < 4; ++j) {
      const int k = i == 0 ? (j == 1 ? 2 : 1) : 0;
      const int l = 6 - i - j - k;
      least = std::min(least, (*x[i] - *x[j]).norm() / (normal[k] * normal[l]));
    }
  const double regular = 2 * std::numbers::sqrt2 / 3;
  return 6 * signed_volume(a, b, c, d) * least / regular;
}

double mean_ratio(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) noexcept {
  const double squares = (a - b).squaredNorm() + (a - c).squaredNorm() + (a - d).squaredNorm() +
                         (b - c).squaredNorm() + (b - d).squaredNorm() + (c - d).squaredNorm();
  const double ratio = 12 * std::cbrt(std::pow(3 * std::abs(signed_volume(a, b, c, d)), 2)) / squares;
  // Of a point, and of what is too large for its square: none.
  return std::isfinite(ratio) ? ratio : 0;
}

std::vector<int> pieces_of(const TetMesh& mesh) {
  std::vector<Edge> joined;
  for (const Tet& t : mesh.tets)
    for (int corner = 1; corner < 4; ++corner) joined.push_back({t[0], t[corner]});
  return roots(static_cast<int>(mesh.nodes.size()), joined);
}

MeshQuality measure_mesh(const TetMesh& mesh) {
  MeshQuality q;
  Tally ratio, dihedral, volume, length;
  std::set<Edge> edges;
  for (const Tet& t : mesh.tets) {
    const std::array<Vec3, 4> x = {mesh.nodes[t[0]], mesh.nodes[t[1]], mesh.nodes[t[2]], mesh.nodes[t[3]]};
    const double eta = mean_ratio(x[0], x[1], x[2], x[3]);
    ++q.histogram[std::clamp(static_cast<int>(10 * eta), 0, 9)];
    q.slivers += eta < sliver;
    ratio.add(eta);
    volume.add(signed_volume(x[0], x[1], x[2], x[3]));
    q.total_volume += signed_volume(x[0], x[1], x[2], x[3]);
    add_dihedrals(x, dihedral);
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < a; ++b) edges.insert(edge_of(t[a], t[b]));
  }
  for (const auto& [a, b] : edges) length.add((mesh.nodes[a] - mesh.nodes[b]).norm());
  q.ratio = ratio.span();
  q.dihedral = dihedral.span();
  q.volume = volume.span();
  q.edge = length.span();
  measure_boundary(mesh, q);
  const std::vector<int> piece = pieces_of(mesh);
  q.pieces = static_cast<int>(std::set<int>(piece.begin(), piece.end()).size());
  if (!mesh.nodes.empty()) q.low = q.high = mesh.nodes.front();
  for (const Vec3& x : mesh.nodes) {
    q.low = q.low.cwiseMin(x);
    q.high = q.high.cwiseMax(x);
  }
  return q;
}

}  // namespace hapticd
