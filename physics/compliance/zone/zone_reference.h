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
// no longer be a sum of elements, and its Schur complement may have any sign. The halo, nodes next to the
// zone, is eliminated just before it, in one front with it: a patch node there costs a half solve of that
// front alone. Shapes: S_out 3·zone square, lower triangle; node k of the zone's last places first. Units:
// N/m. Source: DESIGN's method `zone`; departure from the paper: no low-rank term inside the zone.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "physics/compliance/reference_compliance.h"
#include "physics/compliance/factor/node_order.h"
#include "physics/compliance/system_matrix.h"
#include "physics/compliance/zone/leading_columns.h"

namespace hapticd {

// What every reference factor of one body shares; never changes.
struct ZoneStructure {
  ZoneStructure(const TissueModel& model, double step);
  double h;
  NodeGraph graph;
  std::vector<int> fill_order;
  SystemMatrix matrix;  // not assembled: copied
};

class ZoneReference final : public ReferenceFactor {
 public:
  // Copies what it needs of the state. `zone_and_halo`: the first `zone` of them are the zone. `retired`: an
  // old reference factor, whose memory is used again.
  ZoneReference(std::shared_ptr<const ZoneStructure> structure, std::vector<int> zone_and_halo, int zone,
                const TissueState& state, bool quantised_copy,
                std::unique_ptr<ZoneReference> retired = nullptr);

  void make() override;

  bool made() const noexcept { return made_; }
  std::span<const int> zone() const noexcept {
    return {zone_and_halo_.data(), static_cast<std::size_t>(zone_)};
  }
  int zone_size() const noexcept { return zone_; }
  int place(int node) const noexcept { return place_[node]; }               // in the order
  int zone_place(int node) const noexcept { return place_[node] - rest_; }  // < 0: not in the zone
  // The zone's nodes and those of the panel before it, the halo's among them; by a node: its place tells.
  const std::vector<int>& near() const noexcept { return near_; }
  bool is_near(int node) const noexcept { return 3 * place_[node] >= panels_.last_first(); }
  const TissueState& state() const noexcept { return state_; }  // without x and v
  double identity_scale() const noexcept { return identity_scale_; }

  // Elements wholly inside, and one flag for each element.
  const std::vector<int>& inside() const noexcept { return inside_; }
  bool is_inside(int tet) const noexcept { return is_inside_[tet] != 0; }

  // Changed by what is carried over: see far_field_updates.h.
  LeadingColumns& panels() noexcept { return panels_; }
  const LeadingColumns& panels() const noexcept { return panels_; }
  MatX& outer_corner() noexcept { return S_out_; }

  // Adds Qᵀ A_in Q of the live inside elements to the lower triangle of S.
  void add_inside(const TissueState& now, std::span<const Mat3> Q,
                  Eigen::Ref<MatX, 0, Eigen::OuterStride<>> S) const noexcept;

 private:
  void find_inside();

  std::shared_ptr<const ZoneStructure> structure_;
  std::vector<int> zone_and_halo_;
  int zone_;
  TissueState state_;
  bool quantised_copy_;
  std::unique_ptr<ZoneReference> retired_;
  bool made_ = false;
  int rest_ = 0;  // nodes before the zone
  std::vector<int> place_;
  std::vector<int> near_;
  std::vector<int> inside_;
  std::vector<std::uint8_t> is_inside_;
  LeadingColumns panels_;
  PageMemory workspace_;  // of the factor, for the next reference factor's
  MatX S_out_;
  double identity_scale_ = 1;
};

}  // namespace hapticd
