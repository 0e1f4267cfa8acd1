#include "physics/simulation/wide_coulomb.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <Eigen/LU>

namespace hapticd {
namespace {

constexpr int first_sweeps = 2;
constexpr int longest_run_of_sweeps = 64;
constexpr int most_halvings = 5;

enum class Mode { stick, slip, frictionless };

struct Unknowns {
  int contact;
  Mode mode;
  Eigen::Index first = 0;
  Vec3 along = Vec3::UnitX();  // slip: (1, μ d)
  Vec3 across = Vec3::Zero();  // slip: (0, t̂)
  double lambda_n = 0;
  int count() const { return mode == Mode::stick ? 3 : mode == Mode::slip ? 2 : 1; }
  Vec3 trial(int k) const { return mode == Mode::stick ? Vec3(Vec3::Unit(k)) : k == 0 ? along : across; }
  Vec3 test(int k) const { return mode == Mode::slip && k == 1 ? across : Vec3(Vec3::Unit(k)); }
};

class Solver {
 public:
  Solver(const MatX& W, const VecX& q, std::span<const double> mu, const CoulombOptions& options)
      : A_(W), q_(q), mu_(mu), n_(static_cast<int>(mu.size())), rho_(mu.size()), local_(mu.size()) {
    for (int i = 0; i < n_; ++i) {
      const double mean = W.block<3, 3>(3 * i, 3 * i).trace() / 3;
      rho_[i] = mean > std::numeric_limits<double>::min() ? 1 / mean : 0;
      A_.diagonal().segment<3>(3 * i).array() += options.relative_diagonal * mean;
      local_[i] = CoulombContact(A_.block<3, 3>(3 * i, 3 * i), mu[i]);
    }
  }

  VecX delta(const VecX& lambda) const { return q_ + A_ * lambda; }

  void sweep(VecX& lambda, VecX& d) const {
    for (int i = 0; i < n_; ++i) {
      const Vec3 l = lambda.segment<3>(3 * i);
      if (d[3 * i] >= 0 && l.isZero(0)) continue;
      const Vec3 next = local_[i].solve(Vec3(d.segment<3>(3 * i)) - A_.block<3, 3>(3 * i, 3 * i) * l);
      const Vec3 change = next - l;
      if (change.isZero(0)) continue;
      lambda.segment<3>(3 * i) = next;
      d.noalias() += A_.middleCols<3>(3 * i) * change;
    }
  }

  double natural_map(const VecX& lambda, const VecX& d) const {
    double worst = 0, scale = 0;
    for (int i = 0; i < n_; ++i) {
      const Vec3 l = lambda.segment<3>(3 * i), g = d.segment<3>(3 * i);
      Vec3 v = l - rho_[i] * g;
      v[0] -= rho_[i] * mu_[i] * g.tail<2>().norm();
      worst = std::max(worst, (l - project_on_cone(v, mu_[i])).squaredNorm());
      scale = std::max({scale, l.squaredNorm(), rho_[i] * rho_[i] * q_.segment<3>(3 * i).squaredNorm()});
    }
    return worst > 0 ? std::sqrt(worst / scale) : 0;
  }

  double merit(const VecX& lambda, const VecX& d) const {
    double sum = 0;
    for (int i = 0; i < n_; ++i) {
      const Vec3 l = lambda.segment<3>(3 * i);
      Vec3 y = l - rho_[i] * d.segment<3>(3 * i);
      y[0] = std::max(0.0, y[0]);
      const double pulled = y.tail<2>().norm(), disc = mu_[i] * y[0];
      if (pulled > disc) y.tail<2>() *= disc / pulled;
      sum += (l - y).squaredNorm();
    }
    return 0.5 * sum;
  }

  // From λ and its δ to `trial`, in the cones. False where the system is singular.
  bool newton(const VecX& lambda, const VecX& d, VecX& trial) const {
    std::vector<Unknowns> unknown;
    trial.setZero(3 * n_);
    for (int i = 0; i < n_; ++i) {
      const Vec3 l = lambda.segment<3>(3 * i), y = l - rho_[i] * d.segment<3>(3 * i);
      if (!(y[0] > 0)) continue;
      Unknowns u{i, Mode::frictionless};
      const double pulled = y.tail<2>().norm();
      trial.segment<3>(3 * i) = l;
      if (mu_[i] <= 0) {
        trial.segment<2>(3 * i + 1).setZero();
      } else if (pulled <= mu_[i] * y[0]) {
        u.mode = Mode::stick;
      } else {
        u.mode = Mode::slip;
        const Vec3 t(0, y[1] / pulled, y[2] / pulled);
        u.along = Vec3::UnitX() + mu_[i] * t;
        u.across = Vec3(0, -t[2], t[1]);
        u.lambda_n = l[0] > 0 ? l[0] : y[0];
        trial.segment<3>(3 * i) = u.lambda_n * u.along;
      }
      unknown.push_back(u);
    }
    VecX step;
    for (;;) {
      if (!reduced(unknown, trial, step)) return false;
      const auto pulled = [&](const Unknowns& u) { return trial[3 * u.contact] + step[u.first] < 0; };
      const auto gone = std::stable_partition(unknown.begin(), unknown.end(),
                                              [&](const Unknowns& u) { return !pulled(u); });
      if (gone == unknown.end()) break;
      for (auto u = gone; u != unknown.end(); ++u) trial.segment<3>(3 * u->contact).setZero();
      unknown.erase(gone, unknown.end());
    }
    for (const Unknowns& u : unknown) move(u, step, trial);
    return true;
  }

 private:
  bool reduced(std::vector<Unknowns>& unknown, const VecX& base, VecX& step) const {
    Eigen::Index size = 0;
    for (Unknowns& u : unknown) {
      u.first = size;
      size += u.count();
    }
    const VecX d = delta(base);
    MatX J(size, size);
    step.resize(size);
    for (const Unknowns& uj : unknown) {
      const Vec3 dj = d.segment<3>(3 * uj.contact);
      for (int b = 0; b < uj.count(); ++b) step[uj.first + b] = -uj.test(b).dot(dj);
      for (const Unknowns& ui : unknown) {
        const Mat3 block = A_.block<3, 3>(3 * ui.contact, 3 * uj.contact);
        for (int b = 0; b < uj.count(); ++b) {
          const Vec3 moved = block * uj.trial(b);
          for (int a = 0; a < ui.count(); ++a) J(ui.first + a, uj.first + b) = ui.test(a).dot(moved);
        }
      }
      if (uj.mode != Mode::slip) continue;
      const double mu = mu_[uj.contact], slip = -(uj.along - Vec3::UnitX()).dot(dj) / mu;
      J(uj.first + 1, uj.first + 1) += std::max(0.0, slip) / (mu * uj.lambda_n);
    }
    if (size == 0) return true;
    step = J.partialPivLu().solve(step).eval();
    return step.allFinite();
  }

  void move(const Unknowns& u, const VecX& step, VecX& trial) const {
    auto l = trial.segment<3>(3 * u.contact);
    const double mu = mu_[u.contact];
    if (u.mode == Mode::frictionless) {
      l = Vec3(std::max(0.0, l[0] + step[u.first]), 0, 0);
    } else if (u.mode == Mode::slip) {
      const double n = std::max(0.0, u.lambda_n + step[u.first]);
      Vec3 t = n > 0 ? Vec3(u.along - Vec3::UnitX() + step[u.first + 1] / n * u.across) : Vec3::Zero();
      if (n > 0) t *= mu * n / t.norm();
      l = Vec3(n, t[1], t[2]);
    } else {
      l += step.segment<3>(u.first);
      l[0] = std::max(0.0, l[0]);
      const double t = l.tail<2>().norm();
      if (t > mu * l[0]) l.tail<2>() *= mu * l[0] / t;
    }
  }

  MatX A_;  // W + ε D
  const VecX& q_;
  std::span<const double> mu_;
  int n_;
  std::vector<double> rho_;
  std::vector<CoulombContact> local_;
};

}  // namespace

CoulombResult solve_wide_coulomb(const MatX& W, const VecX& q, std::span<const double> mu, VecX& lambda,
                                 const CoulombOptions& options) {
  CoulombResult result;
  if (!q.allFinite() || !W.allFinite()) {
    lambda.setZero(q.size());
    result.status = SolveStatus::not_finite;
    return result;
  }
  if (lambda.size() != q.size() || !lambda.allFinite()) lambda.setZero(q.size());
  const Solver solver(W, q, mu, options);
  VecX d = solver.delta(lambda), best = lambda, trial;
  result.residual = solver.natural_map(lambda, d);
  const auto keep = [&] {
    const double residual = solver.natural_map(lambda, d);
    if (!(residual < result.residual)) return;
    result.residual = residual;
    best = lambda;
  };
  const auto finished = [&] { return !(result.residual > options.tolerance); };

  int run = first_sweeps;
  while (!finished() && result.sweeps < options.max_sweeps) {
    for (int k = 0; k < run && result.sweeps < options.max_sweeps; ++k, ++result.sweeps)
      solver.sweep(lambda, d);
    d = solver.delta(lambda);
    keep();
    run = std::min(2 * run, longest_run_of_sweeps);
    double merit = solver.merit(lambda, d);
    while (!finished() && result.newton < options.max_newton) {
      ++result.newton;
      const VecX start = lambda, d_start = d;
      bool moved = solver.newton(lambda, d, trial);
      double length = 1;
      for (int halved = 0; moved; ++halved, length *= 0.5) {
        lambda = start + length * (trial - start);
        d = solver.delta(lambda);
        const double next = solver.merit(lambda, d);
        if (next < (1 - 0.2 * length) * merit) {
          merit = next;
          break;
        }
        moved = halved + 1 < most_halvings;
      }
      if (!moved) {
        lambda = start;
        d = d_start;
        break;
      }
      keep();
    }
  }

  lambda = best;
  if (!finished()) result.status = SolveStatus::iteration_cap;
  for (int i = 0; i < static_cast<int>(mu.size()); ++i) {
    const Vec3 l = lambda.segment<3>(3 * i);
    if (!(l[0] > 0)) continue;
    ++result.active;
    if (mu[i] > 0 && l.tail<2>().norm() > (1 - 1e-9) * mu[i] * l[0]) ++result.sliding;
  }
  return result;
}

}  // namespace hapticd
