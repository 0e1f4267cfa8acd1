#include "physics/contact/solver/coulomb.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "physics/contact/solver/coulomb_newton.h"

namespace hapticd {
namespace {

constexpr int longest_run_of_sweeps = 32;
constexpr int sweeps_between_checks = 4;
constexpr int most_halvings = 5;
constexpr int sweeps_of_polish = 2;  // and of the first run, whose time they are judged by
constexpr double good_chord = 0.1;   // of the merit left: the LU is good for another step
constexpr double lost = 1e5;      // of the merit: a step taken without asking does not come back from there
constexpr double settling = 0.3;  // of the shift left after a step that served …
constexpr double least_shift = 1e-4;   // … and below this, none
constexpr int dear_steps = 8;          // LUs that the later stages are not begun without time for
constexpr double hyperstatic = 1e-5;   // ratio of LU pivots below which freedoms are missing
constexpr int solves_raised = 20;      // that keep a raised diagonal
constexpr int most_rounds = 8;         // in which a raised diagonal is taken off again
constexpr double largest_start = 1e6;  // of the free gaps' forces

// How Newton is run, one after the other: ρ, the first shift of the Jacobian's diagonal, whether steps may
// leave the cones (raw), and how many are taken without asking where none lowers the merit.
struct Stage {
  double stretch, shift;
  bool raw;
  int unasked;
};
constexpr Stage stages[] = {
    {1, 0, true, 6}, {1, 1e-2, true, 8}, {1, 0, false, 8}, {10, 0, true, 8}, {100, 0, true, 8}};

double mean_diagonal(const Eigen::Ref<const MatX>& W, int i) noexcept {
  return (W(3 * i, 3 * i) + W(3 * i + 1, 3 * i + 1) + W(3 * i + 2, 3 * i + 2)) / 3;
}

// Natural map of given δ and λ, times `scale`; D_i = 1/rho[i]. An open contact costs a comparison.
double natural_map(const double* delta, const double* lambda, std::span<const double> rho,
                   std::span<const double> mu, double& scale) noexcept {
  double worst = 0;
  for (std::size_t i = 0; i < mu.size(); ++i) {
    const Eigen::Map<const Vec3> l(lambda + 3 * i), d(delta + 3 * i);
    if (d[0] >= 0 && l.isZero(0)) continue;
    Vec3 v = l - rho[i] * d;
    v[0] -= rho[i] * mu[i] * d.tail<2>().norm();
    worst = std::max(worst, (l - project_on_cone(v, mu[i])).squaredNorm());
    scale = std::max(scale, l.squaredNorm());
  }
  return worst;
}

// max_i (ρ_i ‖q_i‖)²: what contact forces are measured against, besides themselves.
double free_scale(const Eigen::Ref<const VecX>& q, std::span<const double> rho) noexcept {
  double scale = 0;
  for (std::size_t i = 0; i < rho.size(); ++i)
    scale = std::max(scale, rho[i] * rho[i] * q.segment<3>(static_cast<Eigen::Index>(3 * i)).squaredNorm());
  return scale;
}

// Forces whose squares are beyond all numbers solve nothing.
double relative(double worst, double scale) noexcept {
  if (!std::isfinite(scale)) return std::numeric_limits<double>::infinity();
  return worst > 0 ? std::sqrt(worst / scale) : 0;
}

// ½ Σ ‖λ_i − P_i(λ_i − ρ_i δ_i)‖², P_i onto λ_n ≥ 0 and the disc of radius μ y_n (Alart and Curnier).
double alart_curnier(const CoulombSystem& s, const double* lambda, const double* delta) noexcept {
  double sum = 0;
  for (int i = 0; i < s.contacts; ++i) {
    const Eigen::Map<const Vec3> l(lambda + 3 * i), d(delta + 3 * i);
    if (d[0] >= 0 && l.isZero(0)) continue;
    Vec3 y = l - s.stretch * s.rho[i] * d;
    y[0] = std::max(0.0, y[0]);
    const double pulled = y.tail<2>().squaredNorm(), disc = s.mu[i] * y[0];
    if (pulled > disc * disc) y.tail<2>() *= disc / std::sqrt(pulled);
    sum += (l - y).squaredNorm();
  }
  return 0.5 * sum;
}

// Into the cone at the same λ_n: what a raw step leaves outside is of the residual's size.
Vec3 feasible(const Vec3& l, double mu) noexcept {
  if (!(l[0] > 0)) return Vec3::Zero();
  const double t = l.tail<2>().norm(), scale = t > mu * l[0] ? mu * l[0] / t : 1;
  return {l[0], scale * l[1], scale * l[2]};
}

// 1 / mean diagonal, or 0 for a contact that W does not move at all.
double inverse_or_zero(double d) noexcept { return d > std::numeric_limits<double>::min() ? 1 / d : 0; }

class CoulombSolve {
 public:
  CoulombSolve(CoulombSystem& system, Eigen::Ref<VecX> lambda, CoulombWorkspace& ws,
               const CoulombOptions& options, CoulombResult& result) noexcept
      : s_(system),
        lambda_(lambda),
        ws_(ws),
        options_(options),
        result_(result),
        rows_(3 * system.contacts),
        free_scale_(free_scale(system.q, system.rho.first(system.mu.size()))),
        most_sweeps_(options.max_sweeps),
        most_newton_(options.max_newton) {}

  void run() noexcept {
    begin(ws_.raised > 0 ? options_.raised_diagonal : options_.relative_diagonal);
    if (ws_.raised > 0) --ws_.raised;
    alternate();
    // What all of that has left unsolved is ill-posed as it stands; once more, on a softer problem.
    if (!done() && !hurried_ && !options_.deadline.passed()) {
      raise(std::max(options_.raised_diagonal, 10 * s_.epsilon));
      most_sweeps_ += options_.max_sweeps;
      most_newton_ += options_.max_newton;
      alternate();
    }
    if (done() && s_.epsilon >= options_.raised_diagonal) take_off_raised();
    if (!done()) polish();
    std::copy_n(done() ? ws_.best.data() : ws_.swept.data(), rows_, lambda_.data());
    result_.relative_diagonal = s_.epsilon;
    if (done()) return;
    result_.residual = swept_residual_;
    result_.status =
        options_.deadline.passed() || hurried_ ? SolveStatus::deadline : SolveStatus::iteration_cap;
  }

 private:
  // Sweeps and Newton in turns.
  void alternate() noexcept {
    for (int length = 2; open(); length = std::min(2 * length, longest_run_of_sweeps)) {
      // The warm start did not serve.
      if (length == 4) {
        lambda_.setZero();
        s_.compute_delta(lambda_.data(), ws_.delta.data());
      }
      sweeps(length);
      for (const Stage& stage : stages) {
        if (open() && (&stage == stages || affords(dear_steps))) newton(stage);
        if (open() && !affords(dear_steps)) hurried_ = true;
        if (open() && &stage != stages && s_.epsilon < options_.raised_diagonal &&
            result_.factorisations > 0 && ws_.factor.pivot_ratio < hyperstatic)
          raise(options_.raised_diagonal);
      }
    }
  }

  // A raw step that is cut off at the cones has a wrong sum of forces, of whatever size its residual is; a
  // sweep keeps the sum, and is in the cones.
  void polish() noexcept {
    if (rough_) sweeps(sweeps_of_polish);
    while (!done() && result_.sweeps < most_sweeps_ && options_.deadline.bounded() &&
           options_.deadline.left() > polish_ns_)
      sweeps(sweeps_of_polish);
  }

  void raise(double epsilon) noexcept {
    std::copy_n(ws_.best.data(), rows_, lambda_.data());
    begin(epsilon);
    ws_.raised = solves_raised;
  }

  bool open() const noexcept {
    return !done() && !hurried_ && result_.sweeps < most_sweeps_ && !options_.deadline.passed();
  }

  // From now on with this relative diagonal: another problem, with a best of its own.
  void begin(double epsilon) noexcept {
    s_.epsilon = epsilon;
    std::fill_n(ws_.prepared.begin(), s_.contacts, std::uint8_t{0});
    result_.residual = swept_residual_ = std::numeric_limits<double>::infinity();
    keep_in_cones(lambda_.data());
    s_.compute_delta(lambda_.data(), ws_.delta.data());
    judge(true);
  }

  // What a raised ε adds to the gaps is taken off again, about the forces found: each round errs by ε times
  // the last round's change (Rockafellar's proximal point iteration). A round that ends unsolved is left out.
  void take_off_raised() noexcept {
    const CoulombResult reached = result_;
    for (int round = 0; round < most_rounds && done() && !hurried_ && !options_.deadline.passed(); ++round) {
      std::copy_n(ws_.best.data(), rows_, ws_.anchor.data());
      s_.anchor = ws_.anchor.data();
      std::copy_n(ws_.anchor.data(), rows_, lambda_.data());
      begin(s_.epsilon);
      if (done()) break;
      alternate();
      if (done()) continue;
      std::copy_n(ws_.anchor.data(), rows_, ws_.best.data());
      result_.residual = reached.residual;
      break;
    }
  }

  bool done() const noexcept { return !(result_.residual > options_.tolerance); }

  // Time for so many LUs like the last one.
  bool affords(int factors) const noexcept {
    const double n = ws_.factor.size, ns = factors * n * n * (n + 18) * ws_.factor.ns_per_flop;
    return !options_.deadline.bounded() || ns < static_cast<double>(options_.deadline.left());
  }

  void keep_in_cones(double* lambda) const noexcept {
    for (int i = 0; i < s_.contacts; ++i) {
      Eigen::Map<Vec3> l(lambda + 3 * i);
      l = feasible(l, s_.mu[i]);
    }
  }

  double residual_of(const double* lambda, const double* delta) const noexcept {
    double scale = free_scale_;
    const double worst = natural_map(delta, lambda, s_.rho, s_.mu, scale);
    return relative(worst, scale);
  }

  // λ at ws.delta = δ(λ): kept if it is the best so far, of all or of those that a sweep has left. What
  // solves the problem from outside the cones has to solve it inside them too, for that is what is returned.
  // True if λ was moved for that.
  bool judge(bool swept) noexcept {
    double residual = residual_of(lambda_.data(), ws_.delta.data());
    const bool moves = !swept && residual <= options_.tolerance;
    if (moves) {
      keep_in_cones(lambda_.data());
      s_.compute_delta(lambda_.data(), ws_.delta.data());
      residual = residual_of(lambda_.data(), ws_.delta.data());
    }
    rough_ = !swept;
    if (swept && residual < swept_residual_) {
      swept_residual_ = residual;
      std::copy_n(lambda_.data(), rows_, ws_.swept.data());
    }
    if (residual < result_.residual) {
      result_.residual = residual;
      std::copy_n(lambda_.data(), rows_, ws_.best.data());
    }
    return moves;
  }

  void sweeps(int length) noexcept {
    const std::int64_t left = options_.deadline.left();
    for (int k = 1; k <= length && result_.sweeps < most_sweeps_; ++k) {
      sweep();
      ++result_.sweeps;
      const bool late = options_.deadline.passed();
      if (k != length && k % sweeps_between_checks != 0 && !late) continue;
      // Rounding of the many updates must not add up.
      keep_in_cones(lambda_.data());
      s_.compute_delta(lambda_.data(), ws_.delta.data());
      judge(true);
      if (done() || late) break;
    }
    if (length == sweeps_of_polish) polish_ns_ = left - options_.deadline.left();
  }

  // One pass over the contacts; ws.delta follows λ.
  void sweep() noexcept {
    for (int i = 0; i < s_.contacts; ++i) {
      Eigen::Map<Vec3> l(lambda_.data() + 3 * i);
      const Eigen::Map<const Vec3> d(ws_.delta.data() + 3 * i);
      if (d[0] >= 0 && l.isZero(0)) continue;
      Mat3 A = s_.W.block<3, 3>(3 * i, 3 * i);
      A.diagonal().array() += s_.diagonal(i);
      if (!ws_.prepared[i]) ws_.local[i] = CoulombContact(A, s_.mu[i]);
      ws_.prepared[i] = 1;
      const Vec3 next = ws_.local[i].solve(d - A * l);
      const Vec3 change = next - l;
      if (change.isZero(0)) continue;
      l = next;
      s_.add_contact(i, change, ws_.delta.data());
    }
  }

  // Steps that lower the merit. Where none does, some are taken without asking, for a direction of slip that
  // turns far raises the merit before it falls; unless they end well below, or where they are lost, all is
  // put back. The shift shrinks with every step that serves, or the last ones would converge only linearly.
  void newton(const Stage& stage) noexcept {
    s_.stretch = stage.stretch;
    double merit = alart_curnier(s_, lambda_.data(), ws_.delta.data());
    double shift = stage.shift, goal = 0, limit = 0;
    bool fresh = shift > 0, roaming = false, astray = false;
    int unasked = 0;
    const auto settle = [&] { shift = shift > least_shift ? settling * shift : 0; };
    const auto put_back = [&](const double* to) {
      std::copy_n(to, rows_, lambda_.data());
      s_.compute_delta(lambda_.data(), ws_.delta.data());
    };
    const auto take_trial = [&] {
      std::copy_n(ws_.trial.data(), rows_, lambda_.data());
      std::copy_n(ws_.trial_delta.data(), rows_, ws_.delta.data());
      merit = alart_curnier(s_, lambda_.data(), ws_.delta.data());
      fresh = merit >= goal;
      unasked = fresh ? unasked - 1 : 0;
      astray = merit > limit;
      if (!fresh) settle();
      if (judge(false)) merit = alart_curnier(s_, lambda_.data(), ws_.delta.data());
    };
    Deadline deadline = options_.deadline;
    deadline.reserve_ns += 2 * polish_ns_;
    while (!done() && !astray && result_.newton < most_newton_) {
      ++result_.newton;
      std::copy_n(lambda_.data(), rows_, ws_.start.data());
      std::copy_n(ws_.delta.data(), rows_, ws_.start_delta.data());
      const NewtonStep step = newton_step(s_, lambda_.data(), shift, stage.raw, fresh, deadline, ws_);
      result_.factorisations += step.factorisations;
      const bool stepped = step.outcome == NewtonOutcome::stepped;
      if (stepped) s_.compute_delta(ws_.trial.data(), ws_.trial_delta.data());
      double after = merit;
      if (stepped && unasked > 0) {
        take_trial();
      } else if (stepped && (after = search(merit)) < merit) {
        fresh = shift > 0 || after > good_chord * merit;
        merit = after;
        settle();
        if (judge(false)) merit = alart_curnier(s_, lambda_.data(), ws_.delta.data());
      } else {
        put_back(ws_.start.data());
        if (step.outcome == NewtonOutcome::no_time || deadline.passed()) break;
        if (step.factorisations > 0 && (roaming || !stepped)) break;
        if (step.factorisations > 0) {
          roaming = true;
          unasked = stage.unasked;
          goal = good_chord * merit;
          limit = lost * merit;
          std::copy_n(lambda_.data(), rows_, ws_.turning_point.data());
          if (unasked > 0) take_trial();
        } else {
          fresh = true;
        }
      }
    }
    // Where time ends this, the last step's force is better than what its merit says.
    if (roaming && !done() && merit >= goal && affords(dear_steps)) put_back(ws_.turning_point.data());
  }

  // From the start towards ws.trial, halving; leaves λ and δ there. The merit reached, or the old one.
  double search(double merit) noexcept {
    double length = 1;
    for (int halved = 0; halved < most_halvings; ++halved, length *= 0.5) {
      for (int k = 0; k < rows_; ++k) {
        lambda_[k] = ws_.start[k] + length * (ws_.trial[k] - ws_.start[k]);
        ws_.delta[k] = ws_.start_delta[k] + length * (ws_.trial_delta[k] - ws_.start_delta[k]);
      }
      const double after = alart_curnier(s_, lambda_.data(), ws_.delta.data());
      if (after < (1 - 0.2 * length) * merit) return after;
    }
    return merit;
  }

  CoulombSystem& s_;
  Eigen::Ref<VecX> lambda_;
  CoulombWorkspace& ws_;
  const CoulombOptions& options_;
  CoulombResult& result_;
  int rows_;
  double free_scale_;
  int most_sweeps_;
  int most_newton_;
  double swept_residual_ = 0;
  bool rough_ = false;    // λ is a raw step
  bool hurried_ = false;  // no time for another stage
  std::int64_t polish_ns_ = 0;
};

}  // namespace

CoulombFactor::CoulombFactor(int most)
    : mode(most),
      pivot(3 * most),
      lu(static_cast<std::size_t>(padded(3 * most)) * static_cast<std::size_t>(3 * most)) {}

CoulombWorkspace::CoulombWorkspace(int contacts)
    : capacity(contacts),
      local(contacts),
      prepared(contacts),
      rho(contacts),
      reduced(contacts),
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
      factor(contacts) {}

double coulomb_residual(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                        const Eigen::Ref<const VecX>& lambda, std::span<const double> mu) noexcept {
  double worst = 0, scale = 0;
  for (int i = 0; i < static_cast<int>(mu.size()); ++i) {
    const double rho = inverse_or_zero(mean_diagonal(W, i));
    const Vec3 free = q.segment<3>(3 * i);
    const Vec3 delta = free + W.middleRows<3>(3 * i).lazyProduct(lambda);
    scale = std::max(scale, rho * rho * free.squaredNorm());
    worst =
        std::max(worst, natural_map(delta.data(), lambda.data() + 3 * i, {&rho, 1}, mu.subspan(i, 1), scale));
  }
  return relative(worst, scale);
}

CoulombResult solve_coulomb(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q,
                            std::span<const double> mu, Eigen::Ref<VecX> lambda, CoulombWorkspace& ws,
                            std::uint64_t matrix_version, const CoulombOptions& options) noexcept {
  CoulombResult result;
  const int contacts = static_cast<int>(q.size()) / 3;
  const auto refuse = [&](SolveStatus status) {
    lambda.setZero();
    result.status = status;
    ws.factor.version = 0;
    return result;
  };
  const auto sound = [](double m) { return m >= 0 && std::isfinite(m); };
  if (contacts == 0) return result;
  if (contacts > ws.capacity) return refuse(SolveStatus::too_large);
  if (!q.allFinite() || !all_finite(W, matrix_version, ws.finite_version) ||
      !std::all_of(mu.begin(), mu.end(), sound))
    return refuse(SolveStatus::not_finite);
  for (int i = 0; i < contacts; ++i) ws.rho[i] = inverse_or_zero(mean_diagonal(W, i));
  const double free = std::sqrt(free_scale(q, std::span<const double>(ws.rho).first(mu.size())));
  if (!std::isfinite(free)) return refuse(SolveStatus::not_finite);
  if (!(lambda.cwiseAbs().maxCoeff() <= largest_start * free)) lambda.setZero();
  if (matrix_version == 0) ws.factor.version = 0;
  // Within one solve the matrix is the same, whatever the caller promises for the next.
  const std::uint64_t version = matrix_version ? matrix_version : std::numeric_limits<std::uint64_t>::max();
  CoulombSystem system{W, q, mu, ws.rho, options.relative_diagonal, contacts, version};
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
