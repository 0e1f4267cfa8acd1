// The factor that method `zone` solves with: a stale far field, what was removed from it since, a fresh
// corner.
//
//   A ≈ L Lᵀ in three parts:   columns of the rest (leading_columns.h),  λ of the removals carried over
//   (far_field_updates.h),  corner S = Qᵀ A_in(now) Q + S_out (zone_reference.h), factored at each update
//
// Everything is in the reference factor's frame and order: the caller turns vectors by Q, and names nodes by
// their places. Nodes of the rest can join the corner, at a half solve each (`take_in`). A solve is two
// halves, `forward` and `backward`; between them a `Half` can be kept, and halves of several right-hand sides
// added. Shapes: x 3·places of the reference factor, the corner behind the rest; places: of a node in the
// order, −1: not in the system. Units: A [N/m], block [m/N]. Pre: set_reference, then a factor_corner that
// returned true.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "physics/compliance/factor/dense_factor.h"
#include "physics/compliance/patch_inverse.h"
#include "physics/compliance/zone/far_field_updates.h"
#include "physics/compliance/zone/zone_reference.h"

namespace hapticd {

class ZoneFactor {
 public:
  explicit ZoneFactor(PanelPrecision precision) : precision_(precision) {}

  // The reference factor must outlive its use here. Nothing is carried, and the corner is not factored. The
  // corner may grow by `room` nodes without allocation.
  void set_reference(ZoneReference& reference, int room);

  // After nodes were appended to the reference factor's corner.
  void grow_corner() { corner_.resize(static_cast<int>(corner_size())); }

  // These nodes of the rest, all in the system and once each, join the corner, with the elements that then
  // have all theirs there: rotation and gone as ZoneReference::take_in_elements. Returns false if round-off
  // spoilt it: the factor is of no use then.
  [[nodiscard]] bool take_in(std::span<const int> nodes, std::span<const Mat3> rotation,
                             std::span<const std::uint8_t> gone);

  // Adds or takes out V Vᵀ outside the corner, V with three rows for each of these nodes. Returns false, and
  // changes nothing, if A would not stay definite.
  [[nodiscard]] bool carry(std::span<const int> nodes, const Eigen::Ref<const MatX>& V, TermSign sign);
  [[nodiscard]] bool carry(const ElementTerm& term, TermSign sign) {
    return carry({term.node.data(), static_cast<std::size_t>(term.corners)},
                 term.V.topLeftCorner(3 * term.corners, term.rank), sign);
  }
  [[nodiscard]] bool carries_any() const noexcept { return !carried_.empty(); }

  // Returns false if the corner is not positive definite. Zone nodes out of the system get the identity's
  // rows.
  [[nodiscard]] bool factor_corner(const TissueState& state, std::span<const Mat3> Q,
                                   std::span<const std::uint8_t> in_system, PartTimes* times);

  // Where a right-hand side is not zero: from there on the columns have something to do.
  enum class Reach : std::uint8_t { corner, last_panel, all };

  // A solve between its halves: x, and the λ of what is carried.
  struct Half {
    VecX x;
    MatX g;
  };
  void forward(Half& half, Reach reach);  // up to L⁻¹ of the corner: a force on the zone enters no earlier
  void backward(Half& half);              // from there on; x is the solution
  void backward_near(Half& half);         // … of the zone and the last panel alone

  // S⁻¹ of a force on the zone's nodes alone, in place.
  void solve_corner(Eigen::Ref<VecX> corner);
  Eigen::Index corner_size() const noexcept {
    return static_cast<Eigen::Index>(3 * reference_->corner().size());
  }
  Eigen::Ref<VecX> corner_of(VecX& x) const noexcept { return x.segment(rest_dofs(), corner_size()); }

  // C_pp of the nodes at these places; a half solve for each that lies outside the zone.
  void patch(std::span<const int> places, Eigen::Ref<MatX> block);

  std::size_t memory_bytes() const noexcept;

 private:
  Eigen::Index rest_dofs() const noexcept { return reference_->panels().rest_dofs(); }
  DenseFactor::View corner() noexcept { return corner_.matrix(); }
  void through_corner(Half& half);
  void patch_beyond_zone(std::span<const int> outside, std::span<const int> rows, Eigen::Ref<MatX> block);

  PanelPrecision precision_;
  ZoneReference* reference_ = nullptr;
  FarFieldUpdates carried_;
  DenseFactor corner_;
  PatchInverse patch_inverse_;
  std::vector<int> zone_places_;
  std::vector<int> places_;
  MatX g_;
  MatX beyond_;  // zero between uses
};

}  // namespace hapticd
