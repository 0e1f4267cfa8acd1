// What keeps a guarded material from being pushed through itself: a pressure in tetrahedra that have all but
// lost their volume, and nothing anywhere else.
//
//   E_guard = V κ/2 (J₀ − J)²  where J = det F < J₀,   κ = λ + 2μ,   J₀ = 0.6
//   f_a = V p c_a,   p = κ (J₀ − J),   c_a = ∂J/∂x_a = cof(F) g_a
//   K_ab = V (κ c_a c_bᵀ + p ‖F‖ (g_a·g_b) I)
//
// The co-rotational energy measures volume by tr(RᵀF), which a tetrahedron flattened one way and stretched
// another does not change: it can lose all its volume for nothing. The volume barrier measures det F. Its
// force is the exact gradient of its energy and continuous at J₀; K is positive semi-definite and bounds the
// energy's second derivative from above (−∂²J/∂F² ≤ ‖F‖ while J ≥ 0; inside out by up to 2/√3 more). It is
// finite at J = 0 and below: inversion is made dear, not impossible, nor is its undoing sure (README).
// Units: p, κ in Pa; c in 1/m; f in N, K in N/m. Cost: nothing where no tetrahedron is collapsed but its det
// F. Source: Irving, Teran and Fedkiw 2004 for elasticity that survives inversion; a quadratic barrier in J
// is a usual choice, its constants are ours (README).
#pragma once

#include <algorithm>

#include "physics/tissue/tissue.h"

namespace hapticd {

inline constexpr double barrier_from = 0.6;     // J₀
inline constexpr double barrier_stiffness = 1;  // κ over λ + 2μ

// Adds this tetrahedron to `state.collapsed` if it is.
void barrier(const TissueModel& model, int tet, const Mat3& F, TissueState& state) noexcept;

// The volume barrier's energy of this tetrahedron [J]; zero where it has not collapsed.
double barrier_energy(const TissueModel& model, const TissueState& state, int tet, const Mat3& F) noexcept;

// Which corner of the collapsed tetrahedron each of these nodes, the same four, is.
inline std::array<int, 4> corners_in_order(const Tet& wanted, const Tet& node) noexcept {
  std::array<int, 4> corner{};
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < 4; ++b)
      if (node[b] == wanted[a]) corner[a] = b;
  return corner;
}

// Whether they are the same four.
inline bool same_corners(const Tet& a, const Tet& b) noexcept {
  return std::is_permutation(a.begin(), a.end(), b.begin());
}

inline Mat3 barrier_block(const Collapsed& c, int a, int b) noexcept {
  Mat3 K = (c.rank_one * c.push.col(a)) * c.push.col(b).transpose();
  K.diagonal().array() += c.isotropic * c.gradients.col(a).dot(c.gradients.col(b));
  return K;
}

}  // namespace hapticd
