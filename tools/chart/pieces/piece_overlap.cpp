#include "tools/chart/pieces/piece_overlap.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>
#include <vector>

#include "physics/tissue/fragments.h"

namespace hapticd {
namespace {

using Box = Eigen::AlignedBox3d;

std::vector<int> pieces_of_tets(const Body& body) {
  if (body.deformable) return find_pieces(body.model, body.state).of_tet;
  return std::vector<int>(body.model.mesh.tets.size(), 0);
}

bool live(const Body& body, int t) {
  return body.model.mesh.tets[t] != no_tet && (!body.deformable || body.state.alive[t]);
}

// Live tetrahedra by the cells that their boxes meet.
class TetGrid {
 public:
  explicit TetGrid(const Body& body) : body_(body), cell_(std::max(body.edge, 1e-9)) {
    for (int t = 0; t < static_cast<int>(body.model.mesh.tets.size()); ++t) {
      if (!live(body, t)) continue;
      Box box;
      for (const int n : body.model.mesh.tets[t]) box.extend(body.state.x[n]);
      const Eigen::Array3i a = cell(box.min()), b = cell(box.max());
      for (int k = a[2]; k <= b[2]; ++k)
        for (int j = a[1]; j <= b[1]; ++j)
          for (int i = a[0]; i <= b[0]; ++i) tets_[key({i, j, k})].push_back(t);
    }
  }

  // visit(tet) of those that hold p.
  template <typename Visit>
  void holding(const Vec3& p, const Visit& visit) const {
    const auto found = tets_.find(key(cell(p)));
    if (found == tets_.end()) return;
    for (const int t : found->second) {
      const Tet& tet = body_.model.mesh.tets[t];
      Mat3 D;
      for (int c = 0; c < 3; ++c) D.col(c) = body_.state.x[tet[c + 1]] - body_.state.x[tet[0]];
      const Vec3 w = D.inverse() * (p - body_.state.x[tet[0]]);
      if (std::min(w.minCoeff(), 1 - w.sum()) > 0) visit(t);
    }
  }

 private:
  Eigen::Array3i cell(const Vec3& p) const { return (p.array() / cell_).floor().cast<int>(); }
  static std::int64_t key(const Eigen::Array3i& c) {
    return (std::int64_t{c[0]} * 73856093) ^ (std::int64_t{c[1]} * 19349663) ^
           (std::int64_t{c[2]} * 83492791);
  }

  const Body& body_;
  double cell_;
  std::unordered_map<std::int64_t, std::vector<int>> tets_;
};

// From p to the nearest face of that piece.
double distance_to_surface(const Body& body, const std::vector<int>& piece, int of, const Vec3& p) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const SurfaceFace& f : body.surface.faces()) {
    if (piece[f.id / 4] != of) continue;
    const std::array<Vec3, 3> x = {body.state.x[f.nodes[0]], body.state.x[f.nodes[1]],
                                   body.state.x[f.nodes[2]]};
    const auto w = nearest_on_triangle(p, x);
    nearest = std::min(nearest, (p - w[0] * x[0] - w[1] * x[1] - w[2] * x[2]).norm());
  }
  return nearest;
}

void nodes_inside(const Body& points, const Body& other, PieceOverlap& out) {
  const TetGrid grid(other);
  const std::vector<int> own = pieces_of_tets(points), theirs = pieces_of_tets(other);
  const bool same = &points == &other;
  std::vector<int> piece(points.state.x.size(), -1);
  for (const SurfaceFace& f : points.surface.faces())
    for (const int n : f.nodes) piece[n] = own[f.id / 4];
  for (std::size_t n = 0; n < piece.size(); ++n) {
    if (piece[n] < 0) continue;
    double depth = 0;
    grid.holding(points.state.x[n], [&](int t) {
      if (same && theirs[t] == piece[n]) return;
      depth = std::max(depth, distance_to_surface(other, theirs, theirs[t], points.state.x[n]));
    });
    out.nodes += depth > 0;
    out.depth = std::max(out.depth, depth);
  }
}

}  // namespace

PieceOverlap find_overlap(const Bodies& bodies, std::span<const ContactPair> pairs) {
  PieceOverlap out;
  for (const ContactPair& p : pairs) {
    nodes_inside(bodies[p.points], bodies[p.faces], out);
    const bool both = std::any_of(pairs.begin(), pairs.end(), [&](const ContactPair& other) {
      return other.points == p.faces && other.faces == p.points;
    });
    if (p.points != p.faces && !both) nodes_inside(bodies[p.faces], bodies[p.points], out);
  }
  return out;
}

}  // namespace hapticd
