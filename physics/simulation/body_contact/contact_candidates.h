// Which surface nodes of one body may touch which faces of another in this step.
//
// A pair of bodies is opt-in, and one-sided: the first's surface nodes against the second's faces. Name the
// finer one first; name the pair both ways where neither is finer. A body paired with itself: nodes of each
// of its connected pieces against faces of the others, from the step in which they come apart. Nodes are
// fixed in the material, so a contact is found again from step to step by (pair, node), whatever faces it
// slides over. Each piece is an obstacle of its own: a node between three pieces is a candidate of each.
//   broad phase    boxes of the two surfaces, then a uniform grid over the faces in their overlap
//   narrow phase   distance to each face of the neighbouring cells, sign of its plane
// No ghosts: a face that looks the same way as the node's own surface (n_face · n_node > 0.2) is the far side
// of a wall or the inside of a body and never touches; a node that has sunk in is still held by the faces it
// came through, not pushed out at the back. Nodes deeper than `depth` behind a face at the start of the step
// do not see it, wherever the step takes them.
// A node that is inside leaves through a face that it was in front of when the step began: near a convex edge
// the nearest face would change from one linearisation to the next.
// A node meets all faces no farther than its margin, or `slack`, beyond the nearest one: it may slide to
// them. Units: m. Errors: none. Allocates: for the simulation thread only. Cost: linear in faces and nodes of
// the pairs named; nothing without pairs.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "physics/simulation/body.h"
#include "physics/simulation/body_contact/clear_nodes.h"
#include "physics/simulation/body_contact/vertex_face_contact.h"

namespace hapticd {

// Nodes of body `points` against faces of body `faces`.
struct ContactPair {
  int points = 0;
  int faces = 0;
  double friction = 0;  // Coulomb's μ of the pair
};

// A node and the faces of one piece that it may touch.
struct BodyContactCandidate {
  int pair;
  int node;
  int piece;                // SurfaceNormals::piece_of_face
  double margin;            // gap below which it matters [m]
  double gap;               // to the nearest face where it was found, then at the start of the step [m]
  std::vector<int> faces;   // into the surface's faces(), ascending
  std::vector<int> open;    // those that it was in front of when the step began; all, if there are none
  int nearest = -1;         // the nearest face where it was found
  std::vector<int> forced;  // open all the same: none of the others keeps the node out
  double looked_at = 0;     // until the bodies have travelled so far, it cannot overlap [m]
};

// The piece of each tetrahedron (fragments.h); empty for a rigid body.
std::vector<int> pieces_of(const Body& body);

// Normals of a body's surface, at the positions of the last `follow`.
class SurfaceNormals {
 public:
  std::vector<int> nodes;                  // on the surface, ascending
  std::vector<std::array<int, 3>> across;  // per face: the face over the edge opposite each corner, or −1
  std::vector<int> piece_of_face;  // the connected piece it belongs to (fragments.h); 0 of a rigid body
  std::vector<int> piece_of_node;  // per mesh node; −1 off the surface
  std::vector<Vec3> face;          // unit
  std::vector<std::array<Vec3, 3>> edge;  // per face: pseudo-normals opposite each corner, unit

  void set_surface(const Body& body) { set_surface(body, pieces_of(body)); }
  void set_surface(const Body& body, std::span<const int> piece_of_tet);
  void follow(const Body& body);
  // Angle-weighted, unit; zero off the surface. Few are ever asked for.
  const Vec3& node(int n) const;
  std::span<const int> faces_at(int n) const {
    return std::span(face_at_).subspan(start_[n], start_[n + 1] - start_[n]);
  }
  // (Pseudo-)normal at the feature of a face that these weights lie on; not unit on an edge.
  Vec3 feature(const Body& body, int face, const std::array<double, 3>& weight) const;
  // Of x from a face of nodes at y, negative on its tissue's side: beyond a convex edge x is not behind the
  // face, whatever its plane says [m].
  double distance(const Body& body, int face, const Vec3& x, std::span<const Vec3> y) const;
  ContactFace contact_face(const Body& body, int face, const std::array<Vec3, 3>& x) const;

 private:
  std::vector<int> start_, face_at_;       // faces by node
  std::vector<std::array<Vec3, 3>> x_;     // corners of each face
  std::vector<std::array<int, 3>> nodes_;  // … and which nodes they are
  mutable std::vector<Vec3> node_;         // as far as they are known
  mutable std::vector<std::uint8_t> known_;
};

// Positions of one body's nodes.
using Positions = std::function<std::span<const Vec3>(int body)>;
using Margin = std::function<double(int pair, int node)>;

class BodyContactCandidateFinder {
 public:
  explicit BodyContactCandidateFinder(std::vector<ContactPair> pairs) : pairs_(std::move(pairs)) {}

  std::span<const ContactPair> pairs() const { return pairs_; }
  // At the bodies' positions when the step began; of a pair, once `find` has looked for anything.
  const SurfaceNormals& normals(int body) const { return normals_[body]; }

  // After removals: the surface of this body is another.
  void surface_changed(int body);

  // First in each step.
  void begin_step(const Bodies& bodies);

  // Appends the encounters of one pair whose gap is below the node's margin at these positions; nodes for
  // which the margin is NaN are left out. Sorted by node, then piece. Where no node can have come so near,
  // nothing is looked for.
  void find(const Bodies& bodies, int pair, const Positions& x, const Margin& margin, double depth,
            double slack, std::vector<BodyContactCandidate>& out);

 private:
  void follow(const Bodies& bodies, int body);
  bool is_one_piece(const Bodies& bodies, int body);
  // No node of the pair can have come within its margin.
  bool all_clear(const Bodies& bodies, int pair, std::span<const Vec3> x, const Margin& margin,
                 double way) const;

  std::vector<ContactPair> pairs_;
  std::vector<ClearNodes> clear_;  // of each pair
  std::vector<SurfaceNormals> normals_;
  std::vector<std::uint8_t> changed_, followed_;  // its surface since the last normals; they are of this step
  std::vector<std::vector<int>> pieces_;          // of each body's tetrahedra; empty: not known
  // The grid: faces per cell, in one list.
  std::vector<int> cell_start_, cell_face_;
};

}  // namespace hapticd
