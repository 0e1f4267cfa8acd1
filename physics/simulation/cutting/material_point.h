// A point fixed in the tissue, and its way through the rest shape: where the front of a cut is.
//
//   x(X) = Σ_a N_a(X) x_a,   N_a(X + s d) = N_a(X) + s g_a·d
//
// A walk goes from tetrahedron to tetrahedron through the faces they share. Where a face has no other side,
// it slides along it if it grazes it, and else ends there. Units: m; weights sum to 1. Shapes: one weight for
// each corner of the tetrahedron. Errors: a point whose tetrahedron went has `tet` −1. Guarantee: no
// allocation; bounded by `most_crossings` faces.
#pragma once

#include <array>
#include <optional>

#include "physics/tissue/tissue.h"

namespace hapticd {

struct MaterialPoint {
  int tet = -1;  // −1: nowhere
  std::array<double, 4> weight{};
  Vec3 rest = Vec3::Zero();

  bool any() const noexcept { return tet >= 0; }
};

// The point of the tetrahedron with this rest place, which may lie outside of it.
MaterialPoint point_in(const TissueModel& model, int tet, const Vec3& rest) noexcept;

// The point of the tetrahedron that is at `place` when its nodes are at x; nowhere if that is outside of it,
// or it is inside out.
MaterialPoint point_at(const TissueModel& model, int tet, const std::vector<Vec3>& x,
                       const Vec3& place) noexcept;

Vec3 place_of(const TissueModel& model, const std::vector<Vec3>& x, const MaterialPoint& point) noexcept;

// ∂x/∂X of the point's tetrahedron.
Mat3 deformation_at(const TissueModel& model, const std::vector<Vec3>& x,
                    const MaterialPoint& point) noexcept;

// Moves the point by `way` in the rest shape. Returns the part of it that it went: below 1 it would have left
// the tissue, and is where it would have.
double walk(const TissueModel& model, const TissueState& state, MaterialPoint& point,
            const Vec3& way) noexcept;

// After a cut: the tetrahedron that the point is in now. It is sought from the one it was in; where that is
// gone, the point is nowhere.
void follow_cut(const TissueModel& model, const TissueState& state, MaterialPoint& point) noexcept;

// Where a segment from p to p + way first enters the tissue through one of these boundary faces, as a part of
// it.
struct SurfaceHit {
  MaterialPoint point;
  double part;
};
class BoundarySurface;
std::optional<SurfaceHit> first_entry(const TissueModel& model, const TissueState& state,
                                      const BoundarySurface& surface, const Vec3& p, const Vec3& way);

}  // namespace hapticd
