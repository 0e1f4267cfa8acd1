// The linear isotropic co-rotational tetrahedron, from gradients that are rotated instead of stiffness.
//
//   F = Σ_a x_a g_aᵀ,   E = V (μ‖F−R‖² + λ/2 tr(RᵀF−I)²)
//   f_a = −V (2μ (F−R) + λ tr(RᵀF−I) R) g_a
//   K_ab = V (λ b_a b_bᵀ + μ b_b b_aᵀ + μ (b_a·b_b) I),   b = R g
//
// With R the nearest rotation, E is stationary in R, so f = −∂E/∂x exactly; K is ∂²E/∂x² where F = R
// and elsewhere the usual positive semi-definite co-rotational tangent.
// Units: g in 1/m, V in m³, μ and λ in Pa, E in J, f in N, K in N/m. No R k Rᵀ is ever formed.
// Guarantee: wait-free, no allocation. Source: Müller and Gross 2004; energy as in McAdams et al. 2011.
#pragma once

#include <array>

#include "physics/tissue/tissue.h"

namespace hapticd {

using Corners = Eigen::Matrix<double, 3, 4>;  // corner positions or forces, one column each

// Rest-shape gradients and signed volume of the tetrahedron (a, b, c, d).
struct RestShape {
  Gradients gradients;
  double volume;
};
RestShape rest_shape(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) noexcept;

inline Corners corners_of(const Tet& tet, const std::vector<Vec3>& x) noexcept {
  Corners corner;
  for (int a = 0; a < 4; ++a) corner.col(a) = x[tet[a]];
  return corner;
}

inline Mat3 deformation_gradient(const Corners& x, const Gradients& g) noexcept { return x * g.transpose(); }

inline double element_energy(const Mat3& F, const Mat3& R, double volume, double mu, double lambda) noexcept {
  const double dilation = R.cwiseProduct(F).sum() - 3.0;
  return volume * (mu * (F - R).squaredNorm() + 0.5 * lambda * dilation * dilation);
}

inline Corners element_forces(const Mat3& F, const Mat3& R, const Gradients& g, double volume, double mu,
                              double lambda) noexcept {
  const double dilation = R.cwiseProduct(F).sum() - 3.0;
  const Mat3 stress = -volume * (2.0 * mu * (F - R) + lambda * dilation * R);
  return stress * g;
}

// K_ab from the rotated gradients of its two corners.
inline Mat3 stiffness_block(const Vec3& b_a, const Vec3& b_b, double volume, double mu,
                            double lambda) noexcept {
  Mat3 K = (volume * lambda * b_a) * b_b.transpose() + (volume * mu * b_b) * b_a.transpose();
  K.diagonal().array() += volume * mu * b_a.dot(b_b);
  return K;
}

}  // namespace hapticd
