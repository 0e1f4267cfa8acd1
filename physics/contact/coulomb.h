// Contact with Coulomb friction: a nonlinear complementarity problem with the *circular* cone,
// solved by block Gauss-Seidel with an exact local solve of each 3×3 contact.
//
//   δ = W λ + q;   per contact: 0 ≤ δ_n ⟂ λ_n ≥ 0,  ‖λ_t‖ ≤ μ λ_n,
//   sliding: δ_t = −c λ_t with c > 0 and ‖λ_t‖ = μ λ_n
//
// Local solve: open if q_n ≥ 0; stick if −W_ii⁻¹ q lies in the cone; else slip, one scalar root
// ‖λ_t(c)‖ = μ λ_n(c) by safeguarded Newton on the 2×2 Schur complement's eigenbasis. δ_t is the
// slip over the solve's period (m), W [m/N], λ [N]; rows ordered n, t1, t2 per contact.
// Existence: for every SPD W and q with W positive definite a solution of the local problem exists;
// for the whole, it exists whenever no motion jams (Painlevé); uniqueness is not claimed for large μ.
// Residual: natural map max_i ‖λ_i − P_K(λ_i − ρ_i(δ_i + μ‖δ_t‖ n))‖ / scale, de Saxcé's correction.
// Guarantee: no allocation, wait-free, bounded by max_sweeps × contacts².
#pragma once

#include <span>

#include "physics/contact/lcp.h"

namespace hapticd {

struct CoulombOptions {
  double tolerance = 1e-8;         // on the residual
  double relative_diagonal = 1e-9;
  int max_sweeps = 200;
};

struct CoulombResult {
  SolveStatus status = SolveStatus::solved;
  int sweeps = 0;
  int active = 0;  // contacts with λ_n > 0
  int sliding = 0;
  double residual = 0;
};

// One contact alone: minimal λ for local matrix A (3×3, SPD) and free gap b.
Vec3 solve_coulomb_contact(const Mat3& A, const Vec3& b, double mu) noexcept;

// Natural-map residual, relative to max(max‖λ_i‖, max‖q_i‖·ρ_i).
double coulomb_residual(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                        const Eigen::Ref<const VecX>& lambda, std::span<const double> mu) noexcept;

// lambda is read as warm start and left as the best iterate.
CoulombResult solve_coulomb(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                            std::span<const double> mu, Eigen::Ref<VecX> lambda,
                            const CoulombOptions& options) noexcept;

}  // namespace hapticd
