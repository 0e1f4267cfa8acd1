// One reduced Newton step of the Coulomb solver (coulomb.h), and the system it and the sweeps share.
//
//   stick: δ = 0 in 3 unknowns;   slip: δ_n = 0, t̂·δ_t + c τ = 0 in λ_n and τ, λ_t = μ λ_n d;   open: none
//
// Guarantee: wait-free, no allocation, one LU of at most `rows` unknowns.
#pragma once

#include "physics/contact/coulomb.h"

namespace hapticd {

// δ = (W + ε D) λ + q with D_i = 1/rho_i on contact i (0 where rho_i = 0).
struct CoulombSystem {
  const Eigen::Ref<const MatX>& W;
  const Eigen::Ref<const VecX>& q;
  std::span<const double> mu;
  std::span<const double> rho;
  double epsilon;
  int contacts;

  double diagonal(int i) const noexcept { return rho[i] > 0 ? epsilon / rho[i] : 0; }
  void add_contact(int i, const Vec3& change, double* delta) const noexcept;  // δ += (W + εD)(:, i) change
  void compute_delta(const double* lambda, double* delta) const noexcept;
};

// From λ and ws.delta = δ(λ) to ws.trial, which lies in the cones. False where the system is singular.
bool newton_step(const CoulombSystem& system, const double* lambda, CoulombWorkspace& ws) noexcept;

}  // namespace hapticd
