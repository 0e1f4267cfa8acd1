// One reduced Newton step of the Coulomb solver (coulomb.h), and the system it and the sweeps share.
//
//   stick: δ = 0 in 3 unknowns;   slip: δ_n = 0, t̂·δ_t + c τ = 0 in λ_n and τ, λ_t = μ λ_n d;
//   frictionless: δ_n = 0;   open, limited: none, λ_n is 0 or the limit
//
// The Jacobian is symmetric but for the columns of slipping contacts' λ_n, which are n + μ d: the border of
// its factor (bordered_factor.h). The factor is kept: while W and the sorting of the contacts stay, the next
// step is a chord step with it, also in the next solve. `shift` adds shift · D to the Jacobian alone: steps
// along freedoms that W does not have stay finite, and the solution is not moved. Guarantee: wait-free, no
// allocation, at most one factor of at most `rows` unknowns, and its solves.
#pragma once

#include "physics/contact/solver/coulomb.h"

namespace hapticd {

// The limit of contact i; none where there are none.
inline double limit_at(std::span<const double> limit, std::size_t i) noexcept {
  return limit.empty() ? no_limit : limit[i];
}

// δ = W λ + ε D (λ − anchor) + q with D_i = 1/rho_i on contact i (0 where rho_i = 0).
struct CoulombSystem {
  const Eigen::Ref<const MatX>& W;
  const Eigen::Ref<const VecX>& q;
  std::span<const double> mu;
  std::span<const double> limit;  // of λ_n; empty: none
  std::span<const double> rho;
  double epsilon;
  int contacts;
  std::uint64_t version;           // of W; 0: not promised to be the last one's
  const double* anchor = nullptr;  // null: zero
  double stretch = 1;              // of ρ, where contacts are sorted and judged
  ColumnsOnDemand columns{};

  double limit_of(int i) const noexcept { return limit_at(limit, static_cast<std::size_t>(i)); }
  double diagonal(int i) const noexcept { return rho[i] > 0 ? epsilon / rho[i] : 0; }
  void add_contact(int i, const Vec3& change, double* delta) const noexcept;  // δ += (W + εD)(:, i) change
  void compute_delta(const double* lambda, double* delta) const noexcept;
};

enum class NewtonOutcome : std::uint8_t { stepped, singular, no_time };

struct NewtonStep {
  NewtonOutcome outcome = NewtonOutcome::stepped;
  int factorisations = 0;  // 0: a chord step
};

// From λ and ws.delta = δ(λ) to ws.trial. raw: the semi-smooth Newton step as it is; otherwise contacts that
// it pulls on leave the system, which is solved again, and the trial lies in the cones. fresh: no chord step.
NewtonStep newton_step(const CoulombSystem& system, const double* lambda, double shift, bool raw, bool fresh,
                       const Deadline& deadline, CoulombWorkspace& ws) noexcept;

}  // namespace hapticd
