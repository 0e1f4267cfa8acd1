#include "physics/contact/coulomb.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "physics/contact/coulomb_newton.h"

namespace hapticd {
namespace {

constexpr int longest_run_of_sweeps = 32;
constexpr int sweeps_between_checks = 4;
constexpr int most_halvings = 5;

double mean_diagonal(const Eigen::Ref<const MatX>& W, int i) noexcept {
  return (W(3 * i, 3 * i) + W(3 * i + 1, 3 * i + 1) + W(3 * i + 2, 3 * i + 2)) / 3;
}

// Natural map of given δ and λ; D_i = 1/rho[i].
double natural_map(const double* delta, const double* lambda, const Eigen::Ref<const VecX>& q,
                   std::span<const double> rho, std::span<const double> mu) noexcept {
  double worst = 0, scale = 0;
  for (std::size_t i = 0; i < mu.size(); ++i) {
    const Eigen::Map<const Vec3> l(lambda + 3 * i), d(delta + 3 * i);
    Vec3 v = l - rho[i] * d;
    v[0] -= rho[i] * mu[i] * d.tail<2>().norm();
    worst = std::max(worst, (l - project_on_cone(v, mu[i])).squaredNorm());
    const Vec3 free = q.segment<3>(static_cast<Eigen::Index>(3 * i));
    scale = std::max({scale, l.squaredNorm(), rho[i] * rho[i] * free.squaredNorm()});
  }
  return worst > 0 ? std::sqrt(worst / scale) : 0;
}

// ½ Σ ‖λ_i − P_i(λ_i − ρ_i δ_i)‖², P_i onto λ_n ≥ 0 and the disc of radius μ y_n (Alart and Curnier).
double alart_curnier(const CoulombSystem& s, const double* lambda, const double* delta) noexcept {
  double sum = 0;
  for (int i = 0; i < s.contacts; ++i) {
    const Eigen::Map<const Vec3> l(lambda + 3 * i), d(delta + 3 * i);
    Vec3 y = l - s.rho[i] * d;
    y[0] = std::max(0.0, y[0]);
    const double pulled = y.tail<2>().norm(), disc = s.mu[i] * y[0];
    if (pulled > disc) y.tail<2>() *= disc / pulled;
    sum += (l - y).squaredNorm();
  }
  return 0.5 * sum;
}

// 1 / mean diagonal, or 0 for a contact that W does not move at all.
double inverse_or_zero(double d) noexcept { return d > std::numeric_limits<double>::min() ? 1 / d : 0; }

class Sweeper {
 public:
  Sweeper(const CoulombSystem& system, CoulombWorkspace& ws) noexcept : s_(system), ws_(ws) {
    for (int i = 0; i < s_.contacts; ++i) {
      Mat3 A = s_.W.block<3, 3>(3 * i, 3 * i);
      A.diagonal().array() += s_.diagonal(i);
      ws_.local[i] = CoulombContact(A, s_.mu[i]);
    }
  }

  // One pass over the contacts; ws.delta follows λ.
  void sweep(double* lambda) noexcept {
    for (int i = 0; i < s_.contacts; ++i) {
      Eigen::Map<Vec3> l(lambda + 3 * i);
      const Eigen::Map<const Vec3> d(ws_.delta.data() + 3 * i);
      if (d[0] >= 0 && l.isZero(0)) continue;
      Mat3 A = s_.W.block<3, 3>(3 * i, 3 * i);
      A.diagonal().array() += s_.diagonal(i);
      const Vec3 next = ws_.local[i].solve(d - A * l);
      const Vec3 change = next - l;
      if (change.isZero(0)) continue;
      l = next;
      s_.add_contact(i, change, ws_.delta.data());
    }
  }

 private:
  const CoulombSystem& s_;
  CoulombWorkspace& ws_;
};

}  // namespace

double coulomb_residual(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                        const Eigen::Ref<const VecX>& lambda, std::span<const double> mu) noexcept {
  std::array<double, max_contacts> rho;
  std::array<double, max_rows> delta;
  for (std::size_t i = 0; i < mu.size(); ++i) rho[i] = inverse_or_zero(mean_diagonal(W, static_cast<int>(i)));
  const CoulombSystem system{W, q, mu, rho, 0.0, static_cast<int>(mu.size())};
  system.compute_delta(lambda.data(), delta.data());
  return natural_map(delta.data(), lambda.data(), q, rho, mu);
}

CoulombResult solve_coulomb(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                            std::span<const double> mu, Eigen::Ref<VecX> lambda, CoulombWorkspace& ws,
                            const CoulombOptions& options) noexcept {
  CoulombResult result;
  const int rows = static_cast<int>(q.size());
  if (!q.allFinite() || !W.diagonal().allFinite()) {
    lambda.setZero();
    result.status = SolveStatus::not_finite;
    return result;
  }
  for (int i = 0; i < rows / 3; ++i) ws.rho[i] = inverse_or_zero(mean_diagonal(W, i));
  const CoulombSystem system{W, q, mu, ws.rho, options.relative_diagonal, rows / 3};
  Sweeper sweeper(system, ws);
  if (!lambda.allFinite()) lambda.setZero();

  const auto residual_at = [&](const double* at) {
    system.compute_delta(at, ws.delta.data());
    return natural_map(ws.delta.data(), at, q, ws.rho, mu);
  };
  const auto keep = [&](double residual) {
    std::copy_n(lambda.data(), rows, ws.best.data());
    result.residual = residual;
  };
  const auto finished = [&] { return !(result.residual > options.tolerance); };

  keep(residual_at(lambda.data()));
  int run = 2;
  while (!finished() && result.sweeps < options.max_sweeps) {
    for (int k = 0; k < run && result.sweeps < options.max_sweeps; ++k) {
      sweeper.sweep(lambda.data());
      ++result.sweeps;
      if (k + 1 != run && (k + 1) % sweeps_between_checks != 0) continue;
      const double residual = residual_at(lambda.data());
      if (residual < result.residual) keep(residual);
      if (finished()) break;
    }
    run = std::min(2 * run, longest_run_of_sweeps);
    double merit = alart_curnier(system, lambda.data(), ws.delta.data());
    while (!finished() && result.newton < options.max_newton) {
      // ws.delta belongs to lambda here.
      ++result.newton;
      std::copy_n(lambda.data(), rows, ws.start.data());
      bool moved = newton_step(system, lambda.data(), ws);
      double length = 1;
      for (int halved = 0; moved; ++halved, length *= 0.5) {
        for (int k = 0; k < rows; ++k) lambda[k] = ws.start[k] + length * (ws.trial[k] - ws.start[k]);
        system.compute_delta(lambda.data(), ws.delta.data());
        const double next = alart_curnier(system, lambda.data(), ws.delta.data());
        if (next < (1 - 0.2 * length) * merit) {
          merit = next;
          break;
        }
        moved = halved + 1 < most_halvings;
      }
      if (!moved) {
        std::copy_n(ws.start.data(), rows, lambda.data());
        system.compute_delta(lambda.data(), ws.delta.data());
        break;
      }
      const double residual = natural_map(ws.delta.data(), lambda.data(), q, ws.rho, mu);
      if (residual < result.residual) keep(residual);
    }
  }

  std::copy_n(ws.best.data(), rows, lambda.data());
  if (!lambda.allFinite() || !std::isfinite(result.residual)) {
    lambda.setZero();
    result.status = SolveStatus::not_finite;
    return result;
  }
  if (!finished()) result.status = SolveStatus::iteration_cap;
  for (int i = 0; i < rows / 3; ++i) {
    const Vec3 l = lambda.segment<3>(3 * i);
    if (!(l[0] > 0)) continue;
    ++result.active;
    if (mu[i] > 0 && l.tail<2>().norm() > (1 - 1e-9) * mu[i] * l[0]) ++result.sliding;
  }
  return result;
}

}  // namespace hapticd
