// The reference factor of method `zone`: an earlier A, factored with the zone last, and split at the zone.
//
//   A = A_in + A_out,   A_in: the live tetrahedra wholly inside the zone (stiffness, damping and their mass),
//   A_out: all others.  S_out = A_out,zz − A_zr A_rr⁻¹ A_rz = L_zz L_zzᵀ − A_in
//
// Later the corner is S = Qᵀ A_in(now) Q + S_out, Q the turns of the nodes since. It is positive definite
// whatever was removed inside and however far everything has turned: A_out ≥ M_out, the mass that its
// elements lump on their nodes, and a Schur complement keeps that order, so S_out ≥ M_out,zz ≥ 0; and
// A_in(now) ≥ M_in(now); so S ≥ M(now), which is positive wherever a live element is left. Elements with a
// node outside the zone must stay as they were in the reference factor: refreshed in A_zz alone, A_out would
// no longer be a sum of elements, and its Schur complement may have any sign. A cut keeps all of that
// (`append`, `reshape`; the proof is in the source). The halo, nodes next to the
// zone, is eliminated just before it, in one front with it: a patch node there costs a half solve of that
// front alone. Shapes: S_out 3·corner square, lower triangle; the corner is the zone, node k of it last
// places first, and behind it the nodes that joined: appended by a cut, or taken in from the rest. Units:
// N/m. Source: DESIGN's method `zone`; departure from the paper: no low-rank term inside the zone.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "physics/compliance/reference_compliance.h"
#include "physics/compliance/zone/far_field_updates.h"
#include "physics/compliance/zone/leading_columns.h"
#include "physics/compliance/zone/zone_mesh.h"

namespace hapticd {

class ZoneReference final : public ReferenceFactor {
 public:
  // Copies what it needs of the state. `zone_and_halo`: the first `zone` of them are the zone. `room`: nodes
  // that can be appended without allocation. `retired`: an old reference factor, whose memory is used again.
  ZoneReference(ZoneMesh mesh, std::vector<int> zone_and_halo, int zone, int room, const TissueState& state,
                bool quantised_copy, std::unique_ptr<ZoneReference> retired = nullptr);

  void make() override;

  bool made() const noexcept { return made_; }
  const ZoneMesh& mesh() const noexcept { return mesh_; }  // with its structure
  // Nodes of the corner: the zone, then those that joined.
  const std::vector<int>& corner() const noexcept { return corner_; }
  int appended() const noexcept { return known_nodes_ - node_count_; }
  int taken_in() const noexcept { return static_cast<int>(corner_.size()) - zone_ - appended(); }
  // In the order; of a node that joined the corner: behind the order; −1 of one that is not known.
  int place(int node) const noexcept { return place_[node]; }
  int places() const noexcept { return rest_ + static_cast<int>(corner_.size()); }
  int zone_place(int node) const noexcept { return place(node) - rest_; }  // < 0: not in the corner
  // The corner's nodes and those of the panel before it, the halo's among them; by a node: its place tells.
  const std::vector<int>& near() const noexcept { return near_; }
  bool is_near(int node) const noexcept { return 3 * place(node) >= panels_.last_first(); }
  const TissueState& state() const noexcept { return state_; }  // without x and v
  double identity_scale() const noexcept { return identity_scale_; }

  // Whether it is wholly inside.
  bool is_inside(int tet) const noexcept { return is_inside_[tet] != 0; }

  // Nodes that came into use since join the corner, not coupled to anything yet. Allocates beyond `room`.
  void append(const TissueModel& model);
  // These nodes of the rest join the corner. They are to be tied to what they were (far_field_updates.h)
  // before `take_in_elements`.
  void take_in(std::span<const int> nodes);
  // Elements outside of these nodes whose nodes have all joined: from S_out, where they are at these
  // rotations, to those inside. `gone`: per tetrahedron, those that are in S_out no more.
  void take_in_elements(std::span<const int> nodes, std::span<const Mat3> rotation,
                        std::span<const std::uint8_t> gone);
  // This element, inside, has that form now: it is so assembled from here on.
  void reshape(int tet, const SystemMatrix::Element& form);
  bool lies_inside(const SystemMatrix::Element& element) const noexcept;
  // Per tetrahedron: as reference factor, corner and what is carried over have it. no_tet: unknown to them.
  std::span<const SystemMatrix::Element> elements() const noexcept { return elements_; }
  const SystemMatrix& law() const noexcept { return mesh_.structure->matrix; }  // moduli and mass alone
  std::span<const std::uint8_t> fixed() const noexcept { return fixed_; }
  int node_count() const noexcept { return node_count_; }  // without the appended

  // Changed by what is carried over: see far_field_updates.h.
  LeadingColumns& panels() noexcept { return panels_; }
  const LeadingColumns& panels() const noexcept { return panels_; }
  FarFieldUpdates::Corner outer_corner() noexcept {
    const auto size = static_cast<Eigen::Index>(3 * corner_.size());
    return S_out_.topLeftCorner(size, size);
  }

  // Adds Qᵀ A_in Q of the live inside elements to the lower triangle of S.
  void add_inside(const TissueState& now, std::span<const Mat3> Q,
                  Eigen::Ref<MatX, 0, Eigen::OuterStride<>> S) const noexcept;

 private:
  // sign · Qᵀ a_e Q of one inside, at this rotation; no Q: not turned.
  void add_element(int tet, double left, const Mat3& rotation, std::span<const Mat3> Q, double sign,
                   Eigen::Ref<MatX, 0, Eigen::OuterStride<>> S) const noexcept;
  void join(int node);
  void make_room();
  void list_outside();

  ZoneMesh mesh_;
  std::vector<int> zone_and_halo_;
  int zone_;
  int room_;
  TissueState state_;
  bool quantised_copy_;
  std::unique_ptr<ZoneReference> retired_;
  bool made_ = false;
  int node_count_ = 0;   // of the order
  int known_nodes_ = 0;  // with those appended
  int rest_ = 0;         // nodes before the zone
  std::vector<int> place_;
  std::vector<int> corner_;
  std::vector<SystemMatrix::Element> elements_;
  std::vector<std::uint8_t> fixed_;
  std::vector<int> near_;
  std::vector<int> inside_;
  std::vector<std::uint8_t> is_inside_;
  std::vector<int> outside_;        // tetrahedra of free nodes of the rest, node after node, when it was made
  std::vector<int> outside_first_;  // per node, and one more
  LeadingColumns panels_;
  PageMemory workspace_;  // of the factor, for the next reference factor's
  MatX S_out_;            // with room; zero beyond the corner
  double identity_scale_ = 1;
};

}  // namespace hapticd
