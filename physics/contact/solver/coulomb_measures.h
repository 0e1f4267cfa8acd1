// What the Coulomb solver (coulomb.h) judges forces by: de Saxcé's natural map for the answer, Alart and
// Curnier's merit for Newton's steps.
//
//   natural map: max_i ‖λ_i − P_K(λ_i − ρ_i(δ_i + μ‖δ_t‖ n))‖² and the scale it is relative to
//   merit: ½ Σ ‖λ_i − P_i(λ_i − ρ_i δ_i)‖², P_i onto 0 ≤ λ_n ≤ limit and the disc of radius μ y_n
//
// ρ_i = 3 / tr W_ii, 0 for a contact that W does not move. Units: W [m/N], δ [m], λ [N]. An open contact
// costs a comparison. A NaN in δ or λ makes the natural map NaN. Guarantee: wait-free, no allocation.
#pragma once

#include <span>

#include "physics/contact/solver/coulomb_newton.h"

namespace hapticd {

double mean_diagonal(const Eigen::Ref<const MatX>& W, int contact) noexcept;

// 1 / d, or 0 for a contact that W does not move at all.
double inverse_or_zero(double d) noexcept;

// Of given δ and λ, squared; `scale` grows to the largest ‖λ_i‖².
double natural_map(const double* delta, const double* lambda, std::span<const double> rho,
                   std::span<const double> mu, std::span<const double> limit, double& scale) noexcept;

// max_i min(ρ_i ‖q_i‖, limit_i)²: what contact forces are measured against, besides themselves.
double free_scale(const Eigen::Ref<const VecX>& q, std::span<const double> rho,
                  std::span<const double> limit) noexcept;

// √(worst / scale); infinite where the scale overflows.
double relative_residual(double worst, double scale) noexcept;

double alart_curnier(const CoulombSystem& system, const double* lambda, const double* delta) noexcept;

// λ of one contact, moved into the cone at the same λ_n, or at its limit.
Vec3 into_cone(const Vec3& lambda, double mu, double limit) noexcept;

}  // namespace hapticd
