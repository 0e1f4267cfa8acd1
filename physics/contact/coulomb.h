// Contact with Coulomb friction: a nonlinear complementarity problem with the *circular* cone, solved by
// block Gauss-Seidel with an exact local solve of each 3×3 contact, finished by a reduced Newton.
//
//   δ = (W + ε D) λ + q;   per contact: 0 ≤ δ_n ⟂ λ_n ≥ 0,  ‖λ_t‖ ≤ μ λ_n,
//   sliding: δ_t = −c λ_t with c > 0 and ‖λ_t‖ = μ λ_n
//   D_i = tr W_ii / 3 · I per contact (isotropic, so that the tangents' choice cannot matter)
//
// Local solve: open if q_n ≥ 0; stick if −W_ii⁻¹ q lies in the cone; else slip, one scalar root
// ‖λ_t(c)‖ = μ λ_n(c) by safeguarded Newton on the 2×2 Schur complement's eigenbasis.
// Newton: y = λ − ρ δ, ρ_i = 3/tr W_ii sorts the contacts (Alart and Curnier 1991): open y_n ≤ 0, no
// unknown; stick ‖y_t‖ ≤ μ y_n, three unknowns, δ = 0; slip, two: λ_n and a turn τ of λ_t = μ λ_n d;
// δ_n = 0, t̂·δ_t + c τ = 0, t̂ ⟂ d, c = ‖δ_t‖/(μ λ_n). A step is kept only if the residual falls;
// otherwise 2, 4, … 32 sweeps follow. An open contact costs one comparison in a sweep.
// δ_t is the slip over the solve's period (m), W [m/N], λ [N]; rows ordered n, t1, t2 per contact.
// μ = 0 is a frictionless contact among others.
// Existence: for every SPD W and q with W positive definite a solution of the local problem exists;
// for the whole, it exists whenever no motion jams (Painlevé); uniqueness is not claimed for large μ.
// Residual: natural map max_i ‖λ_i − P_K(λ_i − ρ_i(δ_i + μ‖δ_t‖ n))‖ / scale, de Saxcé's correction.
// Errors: a status. `iteration_cap`: λ is the best iterate by residual; `not_finite`: λ is zero.
// Guarantee: no allocation, wait-free, bounded by max_sweeps × contacts² and max_newton × rows³.
#pragma once

#include <span>

#include "physics/contact/lcp.h"

namespace hapticd {

struct CoulombOptions {
  double tolerance = 1e-8;         // on the residual
  double relative_diagonal = 1e-9;
  int max_sweeps = 200;
  int max_newton = 40;             // steps in all; 0: sweeps only
};

struct CoulombResult {
  SolveStatus status = SolveStatus::solved;
  int sweeps = 0;
  int newton = 0;  // steps tried
  int active = 0;  // contacts with λ_n > 0
  int sliding = 0;
  double residual = 0;
};

// One contact's matrix, prepared for many right-hand sides.
class CoulombContact {
 public:
  CoulombContact() = default;
  CoulombContact(const Mat3& A, double mu) noexcept;  // A symmetric positive definite

  // λ for the free gap b.
  Vec3 solve(const Vec3& b) const noexcept;

 private:
  Vec3 slip(const Vec3& b) const noexcept;

  Mat3 inverse_ = Mat3::Zero();
  Eigen::Vector2d to_n_ = Eigen::Vector2d::Zero();         // A_tn / A_nn
  Eigen::Matrix2d basis_ = Eigen::Matrix2d::Identity();    // eigenvectors of S = A_tt − A_tn A_nt / A_nn
  Eigen::Vector2d eigenvalue_ = Eigen::Vector2d::Zero();
  double a_nn_ = 0;
  double mu_ = 0;
};

struct CoulombWorkspace {
  std::array<CoulombContact, max_contacts> local;
  std::array<double, max_contacts> rho;
  std::array<double, max_rows> delta;
  std::array<double, max_rows> best;
  std::array<double, max_rows> start;
  std::array<double, max_rows> trial;
  std::array<double, max_rows> step;
  std::array<double, std::size_t(max_rows) * max_rows> jacobian;
};

// One contact alone: minimal λ for local matrix A (3×3, SPD) and free gap b.
Vec3 solve_coulomb_contact(const Mat3& A, const Vec3& b, double mu) noexcept;

// Projection onto the cone ‖t‖ ≤ μ n.
Vec3 project_on_cone(const Vec3& v, double mu) noexcept;

// Natural-map residual for δ = W λ + q, relative to max(max‖λ_i‖, max‖q_i‖·ρ_i).
double coulomb_residual(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                        const Eigen::Ref<const VecX>& lambda, std::span<const double> mu) noexcept;

// lambda is read as warm start and left as the best iterate.
CoulombResult solve_coulomb(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                            std::span<const double> mu, Eigen::Ref<VecX> lambda, CoulombWorkspace& workspace,
                            const CoulombOptions& options) noexcept;

}  // namespace hapticd
