#include "physics/simulation/body_contact/contact_candidates.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

#include "physics/tissue/fragments.h"

namespace hapticd {
namespace {

constexpr double looks_the_same_way = 0.2;  // n_face · n_node
constexpr double against = 1e-3;            // cosine of normals that look against one another
constexpr double resting = 2e-6;            // a face that a node lay on is overlapped by no more [m]
constexpr int most_measured = 16;           // nodes, before all are looked for

using Box = Eigen::AlignedBox3d;

std::array<Vec3, 3> corners(const Triangle& t, std::span<const Vec3> x) {
  return {x[t[0]], x[t[1]], x[t[2]]};
}

Box box_of(const std::array<Vec3, 3>& x) {
  Box box(x[0]);
  box.extend(x[1]);
  box.extend(x[2]);
  return box;
}

// A uniform grid over a box: cells of a point and of a box, clamped to it.
struct Grid {
  Vec3 low;
  Vec3 per_length;  // cells per metre
  Eigen::Array3i size;

  Grid(const Box& box, double cell) : low(box.min()) {
    for (int d = 0; d < 3; ++d) {
      const double length = std::max(box.sizes()[d], 1e-12);
      size[d] = std::clamp(static_cast<int>(length / cell), 1, 32);
      per_length[d] = size[d] / length;
    }
  }
  Eigen::Array3i cell_of(const Vec3& p) const {
    const Eigen::Array3d at = ((p - low).array() * per_length.array()).floor();
    return at.max(0.0).min((size - 1).cast<double>()).cast<int>();
  }
  template <typename Visit>
  void cells_of(const Box& box, const Visit& visit) const {
    const Eigen::Array3i a = cell_of(box.min()), b = cell_of(box.max());
    for (int k = a[2]; k <= b[2]; ++k)
      for (int j = a[1]; j <= b[1]; ++j)
        for (int i = a[0]; i <= b[0]; ++i) visit(i + size[0] * (j + size[1] * k));
  }
};

// Of one piece, where it is and how far any node of it is from where the step began.
struct PieceExtent {
  Box box;
  double moved = 0;
};

std::vector<PieceExtent> extents(const SurfaceNormals& surface, std::span<const Vec3> x,
                                 std::span<const Vec3> start) {
  std::vector<PieceExtent> out;
  for (const int n : surface.nodes) {
    const auto piece = static_cast<std::size_t>(surface.piece_of_node[n]);
    if (piece >= out.size()) out.resize(piece + 1);
    out[piece].box.extend(x[n]);
    out[piece].moved = std::max(out[piece].moved, (x[n] - start[n]).norm());
  }
  return out;
}

// From the nearest of all faces [m].
double distance_to_all(const Vec3& x, std::span<const SurfaceFace> faces, std::span<const Vec3> y) {
  double least = std::numeric_limits<double>::infinity();
  for (const SurfaceFace& f : faces) {
    const std::array<Vec3, 3> c = corners(f.nodes, y);
    const auto w = nearest_on_triangle(x, c);
    least = std::min(least, (x - (w[0] * c[0] + w[1] * c[1] + w[2] * c[2])).squaredNorm());
  }
  return std::sqrt(least);
}

// Some face at the node looks against this direction: its tissue is not all that there is behind the node.
bool any_against(const SurfaceNormals& surface, int node, const Vec3& direction) {
  const auto is_against = [&](int f) { return surface.face[f].dot(direction) < -against; };
  return std::ranges::any_of(surface.faces_at(node), is_against);
}

}  // namespace

std::vector<int> pieces_of(const Body& body) {
  return body.deformable ? label_pieces(body.model, body.state) : std::vector<int>();
}

void SurfaceNormals::set_surface(const Body& body, std::span<const int> piece_of_tet) {
  const auto& faces = body.surface.faces();
  piece_of_face.assign(faces.size(), 0);
  piece_of_node.assign(body.state.x.size(), -1);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    if (body.deformable) piece_of_face[f] = piece_of_tet[faces[f].id / 4];
    for (const int n : faces[f].nodes) piece_of_node[n] = piece_of_face[f];
  }
  start_.assign(body.state.x.size() + 1, 0);
  nodes_.clear();
  for (const SurfaceFace& f : faces) {
    nodes_.push_back(f.nodes);
    for (const int n : f.nodes) ++start_[n + 1];
  }
  std::partial_sum(start_.begin(), start_.end(), start_.begin());
  face_at_.resize(3 * faces.size());
  std::vector<int> fill(start_.begin(), start_.end() - 1);
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (const int n : faces[f].nodes) face_at_[fill[n]++] = static_cast<int>(f);
  nodes.clear();
  across.assign(faces.size(), {-1, -1, -1});
  struct Edge {
    int low, high, face, opposite;
  };
  std::vector<Edge> edges;
  for (int f = 0; f < static_cast<int>(faces.size()); ++f)
    for (int c = 0; c < 3; ++c) {
      const int a = faces[f].nodes[(c + 1) % 3], b = faces[f].nodes[(c + 2) % 3];
      edges.push_back({std::min(a, b), std::max(a, b), f, c});
      nodes.push_back(faces[f].nodes[c]);
    }
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
    return std::tie(a.low, a.high, a.face) < std::tie(b.low, b.high, b.face);
  });
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t end = i;
    while (end < edges.size() && edges[end].low == edges[i].low && edges[end].high == edges[i].high) ++end;
    // Where pieces hang together by an edge alone, four faces share it and none is the other's neighbour.
    if (end - i == 2) {
      across[edges[i].face][edges[i].opposite] = edges[i + 1].face;
      across[edges[i + 1].face][edges[i + 1].opposite] = edges[i].face;
    }
    i = end;
  }
}

void SurfaceNormals::follow(const Body& body) {
  const auto& faces = body.surface.faces();
  face.resize(faces.size());
  x_.resize(faces.size());
  node_.resize(body.state.x.size());
  known_.assign(body.state.x.size(), 0);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const std::array<Vec3, 3>& x = x_[f] = corners(faces[f].nodes, body.state.x);
    face[f] = (x[1] - x[0]).cross(x[2] - x[0]).stableNormalized();
  }
  edge.resize(faces.size());
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (int c = 0; c < 3; ++c) {
      const int other = across[f][c];
      edge[f][c] = other < 0 ? face[f] : (face[f] + face[other]).stableNormalized();
    }
}

const Vec3& SurfaceNormals::node(int n) const {
  if (known_[n]) return node_[n];
  known_[n] = 1;
  Vec3 sum = Vec3::Zero();
  for (const int f : faces_at(n))
    for (int c = 0; c < 3; ++c) {
      if (nodes_[f][c] != n) continue;
      const Vec3 u = x_[f][(c + 1) % 3] - x_[f][c], v = x_[f][(c + 2) % 3] - x_[f][c];
      sum += std::atan2(u.cross(v).norm(), u.dot(v)) * face[f];
    }
  return node_[n] = sum.stableNormalized();
}

ContactFace SurfaceNormals::contact_face(const Body& body, int f, const std::array<Vec3, 3>& x) const {
  ContactFace out;
  out.x = x;
  out.edge = edge[f];
  for (int c = 0; c < 3; ++c) out.corner[c] = node(body.surface.faces()[f].nodes[c]);
  return out;
}

Vec3 SurfaceNormals::feature(const Body& body, int f, const std::array<double, 3>& w) const {
  const int zeros = (w[0] == 0) + (w[1] == 0) + (w[2] == 0);
  for (int c = 0; c < 3; ++c) {
    if (zeros == 1 && w[c] == 0 && across[f][c] >= 0) return face[f] + face[across[f][c]];
    if (zeros == 2 && w[c] != 0) return node(body.surface.faces()[f].nodes[c]);
  }
  return face[f];
}

double SurfaceNormals::distance(const Body& body, int f, const Vec3& x, std::span<const Vec3> y) const {
  const std::array<Vec3, 3> c = corners(body.surface.faces()[f].nodes, y);
  const auto w = nearest_on_triangle(x, c);
  const Vec3 away = x - w[0] * c[0] - w[1] * c[1] - w[2] * c[2];
  const bool beside = w[0] == 0 || w[1] == 0 || w[2] == 0;
  const double side = (beside ? feature(body, f, w) : (c[1] - c[0]).cross(c[2] - c[0])).dot(away);
  return side < 0 ? -away.norm() : away.norm();
}

void BodyContactCandidateFinder::surface_changed(int body) {
  if (body >= static_cast<int>(changed_.size())) return;
  changed_[body] = 1;
  pieces_[body].clear();
  followed_[body] = 0;
  for (std::size_t k = 0; k < pairs_.size(); ++k)
    if (pairs_[k].faces == body) clear_[k].forget();
}

void BodyContactCandidateFinder::begin_step(const Bodies& bodies) {
  if (normals_.empty()) {
    normals_.resize(bodies.size());
    changed_.assign(bodies.size(), 1);
    followed_.assign(bodies.size(), 0);
    pieces_.resize(bodies.size());
    clear_.resize(pairs_.size());
  }
  for (std::size_t b = 0; b < bodies.size(); ++b)
    if (bodies[b].deformable && !bodies[b].asleep) followed_[b] = 0;
  for (std::size_t k = 0; k < pairs_.size(); ++k) clear_[k].follow(bodies[pairs_[k].faces].state.x);
}

void BodyContactCandidateFinder::follow(const Bodies& bodies, int body) {
  if (followed_[body]) return;
  if (pieces_[body].empty()) pieces_[body] = pieces_of(bodies[body]);
  if (changed_[body]) normals_[body].set_surface(bodies[body], pieces_[body]);
  normals_[body].follow(bodies[body]);
  changed_[body] = 0;
  followed_[body] = 1;
}

bool BodyContactCandidateFinder::is_one_piece(const Bodies& bodies, int body) {
  if (pieces_[body].empty()) pieces_[body] = pieces_of(bodies[body]);
  return std::all_of(pieces_[body].begin(), pieces_[body].end(), [](int piece) { return piece <= 0; });
}

bool BodyContactCandidateFinder::all_clear(const Bodies& bodies, int pair, std::span<const Vec3> x,
                                           const Margin& margin, double way) const {
  for (const SurfaceFace& f : bodies[pairs_[pair].points].surface.faces())
    for (const int n : f.nodes)
      if (!clear_[pair].clear(n, x[n], margin(pair, n), way)) return false;
  return true;
}

void BodyContactCandidateFinder::find(const Bodies& bodies, int pair, const Positions& positions,
                                      const Margin& margin, double depth, double slack,
                                      std::vector<BodyContactCandidate>& out) {
  const ContactPair& p = pairs_[pair];
  const SurfaceNormals &own = normals_[p.points], &theirs = normals_[p.faces];
  const auto& faces = bodies[p.faces].surface.faces();
  const std::span<const Vec3> x = positions(p.points), y = positions(p.faces);
  const auto &start = bodies[p.points].state.x, &other_start = bodies[p.faces].state.x;
  if (bodies[p.points].surface.faces().empty() || faces.empty()) return;
  if (p.points == p.faces && is_one_piece(bodies, p.points)) return;
  ClearNodes& clear = clear_[pair];
  const double way = longest_way(other_start, y);
  const bool at_start = x.data() == start.data() && y.data() == other_start.data();
  // Nodes that a removal brought to the surface, one by one. What is nearer than `depth` may have sunk in.
  int measured = 0;
  for (const SurfaceFace& f : bodies[p.points].surface.faces())
    for (const int n : f.nodes) {
      if (!at_start || p.points == p.faces || measured >= most_measured) break;
      if (clear.clear(n, x[n], margin(pair, n), 0)) continue;
      const double distance = distance_to_all(x[n], faces, y);
      const bool far = distance > std::max(margin(pair, n), depth);
      if (far) clear.set(n, x[n], distance);
      measured = far ? measured + 1 : most_measured;
    }
  if (all_clear(bodies, pair, x, margin, way)) return;
  follow(bodies, p.points);
  follow(bodies, p.faces);

  const std::vector<PieceExtent> pieces = extents(theirs, y, other_start);
  struct Asked {
    int node;
    double margin, radius;
  };
  std::vector<Asked> asked;
  double reach = depth;
  Box points;
  for (const int n : own.nodes) {
    const double m = margin(pair, n);
    if (!std::isfinite(m) || clear.clear(n, x[n], m, way)) continue;
    // When the step begins, what has sunk through a wall by up to `depth` is still held; at its end a node
    // matters that is inside, or nearer than m.
    double moved = -1;
    const double own_way = (x[n] - start[n]).norm();
    for (int k = 0; k < static_cast<int>(pieces.size()); ++k) {
      if (p.points == p.faces && k == own.piece_of_node[n]) continue;
      const double near = std::max(m, at_start ? depth : 0);
      if (pieces[k].box.squaredExteriorDistance(x[n]) <= near * near)
        moved = std::max(moved, own_way + pieces[k].moved);
    }
    if (moved < 0) {
      if (at_start) clear.set(n, x[n], std::max(m, depth));
      continue;
    }
    asked.push_back({n, m, std::max(m, depth + moved)});
    reach = std::max(reach, asked.back().radius);
    points.extend(x[n]);
  }
  if (asked.empty()) return;
  const Box overlap(points.min() - Vec3::Constant(reach), points.max() + Vec3::Constant(reach));

  std::vector<int> near, piece_of_near;
  std::vector<Box> boxes;
  double extent = 0;
  for (int f = 0; f < static_cast<int>(faces.size()); ++f) {
    const Box box = box_of(corners(faces[f].nodes, y));
    if (!overlap.intersects(box)) continue;
    near.push_back(f);
    piece_of_near.push_back(theirs.piece_of_face[f]);
    boxes.push_back(box);
    extent += box.diagonal().norm();
  }
  if (near.empty()) {
    for (const Asked& a : asked)
      if (at_start) clear.set(a.node, x[a.node], a.radius);
    return;
  }
  extent /= static_cast<double>(near.size());
  const Grid grid(overlap, std::max(extent, depth));

  cell_start_.assign(grid.size.prod() + 1, 0);
  for (const Box& box : boxes) grid.cells_of(box, [&](int cell) { ++cell_start_[cell + 1]; });
  for (std::size_t c = 1; c < cell_start_.size(); ++c) cell_start_[c] += cell_start_[c - 1];
  cell_face_.resize(cell_start_.back());
  std::vector<int> fill(cell_start_.begin(), cell_start_.end() - 1);
  for (std::size_t k = 0; k < near.size(); ++k)
    grid.cells_of(boxes[k], [&](int cell) { cell_face_[fill[cell]++] = static_cast<int>(k); });

  struct Seen {
    int face, piece;
    double distance;
    double gap;
    bool from_front;  // the node was before it when the step began
  };
  std::vector<Seen> seen;
  std::vector<int> visited(near.size(), -1);
  for (const auto& [node, m, radius] : asked) {
    const int own_piece = p.points == p.faces ? own.piece_of_node[node] : -1;
    seen.clear();
    double least = radius;  // from any face, whether it may be touched or not
    bool met = false;
    const Box around(x[node] - Vec3::Constant(radius), x[node] + Vec3::Constant(radius));
    grid.cells_of(around, [&](int cell) {
      for (int i = cell_start_[cell]; i < cell_start_[cell + 1]; ++i) {
        const int k = cell_face_[i];
        if (piece_of_near[k] == own_piece || visited[k] == node || !around.intersects(boxes[k])) continue;
        visited[k] = node;
        const int f = near[k];
        const std::array<Vec3, 3> c = corners(faces[f].nodes, y);
        const auto w = nearest_on_triangle(x[node], c);
        const double distance = (x[node] - (w[0] * c[0] + w[1] * c[1] + w[2] * c[2])).norm();
        least = std::min(least, distance);
        const double height = theirs.face[f].dot(start[node] - other_start[faces[f].nodes[0]]);
        if (height < -depth) continue;
        const bool from_front = height >= -resting;
        if (theirs.face[f].dot(own.node(node)) > looks_the_same_way &&
            !(from_front && (pieces.size() > 1 || any_against(own, node, theirs.face[f]))))
          continue;
        if (distance > radius) continue;
        const double side =
            theirs.feature(bodies[p.faces], f, w).dot(x[node] - (w[0] * c[0] + w[1] * c[1] + w[2] * c[2]));
        seen.push_back({f, theirs.piece_of_face[f], distance, side < 0 ? -distance : distance, from_front});
      }
    });
    // Each piece is an obstacle of its own: to be inside one is no matter of another that is nearer.
    std::stable_sort(seen.begin(), seen.end(),
                     [](const Seen& a, const Seen& b) { return a.piece < b.piece; });
    for (auto first = seen.begin(); first != seen.end();) {
      const int piece = first->piece;
      const auto last = std::find_if(first, seen.end(), [&](const Seen& s) { return s.piece != piece; });
      const std::span<const Seen> of_piece(first, last);
      first = last;
      const Seen& nearest =
          *std::min_element(of_piece.begin(), of_piece.end(),
                            [](const Seen& a, const Seen& b) { return a.distance < b.distance; });
      if (!(nearest.gap < m)) continue;
      met = true;
      BodyContactCandidate e{pair, node, piece, m, nearest.gap, {}, {}, nearest.face, {}};
      // A node that is inside came through one of those that it was before, be others nearer now.
      for (const Seen& s : of_piece)
        if (s.distance <= nearest.distance + std::max(m, slack) || (nearest.gap < 0 && s.from_front))
          e.faces.push_back(s.face);
      std::sort(e.faces.begin(), e.faces.end());
      out.push_back(std::move(e));
    }
    if (at_start) clear.set(node, x[node], met ? ClearNodes::near : least);
  }
}

}  // namespace hapticd
