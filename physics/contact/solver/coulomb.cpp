#include "physics/contact/solver/coulomb.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "physics/contact/solver/coulomb_measures.h"
#include "physics/contact/solver/coulomb_solve.h"

namespace hapticd {
namespace {

constexpr double largest_start = 1e6;  // of the free gaps' forces

}  // namespace

CoulombFactor::CoulombFactor(int most) : mode(most), jacobian(3 * most) {}

void CoulombWorkspace::forget() noexcept {
  factor.version = 0;
  for (CoulombElimination& e : elimination) e.sticking.forget();
}

CoulombElimination::CoulombElimination(int contacts)
    : sticking(contacts),
      other(contacts),
      lambda(3 * contacts),
      mu(contacts),
      limit(contacts),
      workspace(contacts, false) {}

CoulombWorkspace::CoulombWorkspace(int contacts, bool eliminates)
    : capacity(contacts),
      local(contacts),
      prepared(contacts),
      rho(contacts),
      reduced(contacts),
      slipping(contacts),
      row(3 * contacts),
      mode(contacts),
      delta(3 * contacts),
      best(3 * contacts),
      swept(3 * contacts),
      start(3 * contacts),
      turning_point(3 * contacts),
      start_delta(3 * contacts),
      trial(3 * contacts),
      trial_delta(3 * contacts),
      column(3 * contacts),
      step(3 * contacts),
      anchor(3 * contacts),
      last_anchor(3 * contacts),
      factor(contacts) {
  if (eliminates) elimination.emplace_back(contacts);
}

double coulomb_residual(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                        const Eigen::Ref<const VecX>& lambda, std::span<const double> mu,
                        std::span<const double> limit) noexcept {
  double worst = 0, scale = 0;
  for (int i = 0; i < static_cast<int>(mu.size()); ++i) {
    const double rho = inverse_or_zero(mean_diagonal(W, i));
    const Vec3 free = q.segment<3>(3 * i);
    const Vec3 delta = free + W.middleRows<3>(3 * i).lazyProduct(lambda);
    const double most = limit_at(limit, i);
    scale = std::max(scale, std::min(rho * rho * free.squaredNorm(), most * most));
    const double off =
        natural_map(delta.data(), lambda.data() + 3 * i, {&rho, 1}, mu.subspan(i, 1), {&most, 1}, scale);
    if (std::isnan(off)) return off;
    worst = std::max(worst, off);
  }
  return relative_residual(worst, scale);
}

CoulombResult solve_coulomb(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                            std::span<const double> mu, Eigen::Ref<VecX> lambda, CoulombWorkspace& ws,
                            std::uint64_t matrix_version, const CoulombOptions& options,
                            std::span<const double> limit) noexcept {
  CoulombResult result;
  const int contacts = static_cast<int>(q.size()) / 3;
  const auto refuse = [&](SolveStatus status) {
    lambda.setZero();
    result.status = status;
    ws.forget();
    return result;
  };
  const auto sound = [](double m) { return m >= 0 && std::isfinite(m); };
  if (contacts == 0) return result;
  if (contacts > ws.capacity) return refuse(SolveStatus::too_large);
  if (!q.allFinite() || (!options.columns.make && !all_finite(W, matrix_version, ws.finite_version)) ||
      !std::all_of(mu.begin(), mu.end(), sound) ||
      !std::all_of(limit.begin(), limit.end(), [](double most) { return most >= 0; }))
    return refuse(SolveStatus::not_finite);
  for (int i = 0; i < contacts; ++i) ws.rho[i] = inverse_or_zero(mean_diagonal(W, i));
  const double free = std::sqrt(free_scale(q, std::span<const double>(ws.rho).first(mu.size()), limit));
  if (!std::isfinite(free)) return refuse(SolveStatus::not_finite);
  if (!(lambda.cwiseAbs().maxCoeff() <= largest_start * free)) lambda.setZero();
  if (matrix_version == 0) ws.forget();
  // Within one solve the matrix is the same, whatever the caller promises for the next.
  const std::uint64_t version = matrix_version ? matrix_version : std::numeric_limits<std::uint64_t>::max();
  CoulombSystem system{W, q, mu, limit, ws.rho, options.relative_diagonal, contacts, version};
  system.columns = options.columns;
  CoulombSolve(system, lambda, ws, options, result).run();

  if (!lambda.allFinite() || !std::isfinite(result.residual)) return refuse(SolveStatus::not_finite);
  for (int i = 0; i < contacts; ++i) {
    const Vec3 l = lambda.segment<3>(3 * i);
    if (!(l[0] > 0)) continue;
    ++result.active;
    if (mu[i] > 0 && l.tail<2>().norm() > (1 - 1e-9) * mu[i] * l[0]) ++result.sliding;
  }
  return result;
}

}  // namespace hapticd
