// Sorting: y = λ − ρ δ, ρ_i = 3/tr W_ii sorts the contacts (Alart and Curnier 1991): open y_n ≤ 0, no
// unknown; limited y_n ≥ limit where μ = 0, none; stick ‖y_t‖ ≤ μ y_n, three unknowns, δ = 0; slip, two: λ_n
// and a turn τ of λ_t = μ λ_n d; δ_n = 0, t̂·δ_t + c τ = 0, t̂ ⟂ d, c = (‖y_t‖ − μ y_n)/(ρ μ y_n): the
// semi-smooth Newton step, without the unknowns that its rows give at once. The LU serves as long as W and
// the sorting stay (chord steps), also from one solve to the next.
//
// Order: 2, 4, 8, … 32 sweeps, after each of them Newton as its stages say: as
// it is, with a shifted Jacobian (the shift shrinks as steps serve), with steps held in the cones, whose
// pulled contacts leave, with ρ ten- and a hundredfold; from zero after the first turn. A step is taken if
// the merit (½ of Alart and Curnier's residual squared) falls; what to do where it does not is in
// coulomb_descent.cpp.
//
// Samples that stick on one flat face are hyperstatic (12 unknowns, 9 freedoms): where Newton stalls, shifted
// too, on an LU with pivots 1e5 apart, ε is raised for this solve and the next 20, twice as many if it is
// needed again; where all of this ends unsolved, it is raised (tenfold, if it was already) for one more turn
// with the budgets again. What it adds is taken off. It is not counted from the warm start: what is solved
// would then depend on the solve before, and a held pose's force would wander.
//
// Deadline: looked at after every sweep and before every LU, whose cost is predicted from the last ones.
// Newton ends in time for two sweeps from wherever its steps are, also those taken without asking: sums of
// forces, and so wrenches, are right after one or two steps, long before the residual falls, and a sweep
// keeps them, where cutting a raw step off at the cones may change them by 1 %.
//
// Existence: for every SPD W a solution of the local problem exists; for the whole, where some motion opens
// all contacts at once and μ‖W_nt‖ is small against W_nn; it need not where a motion jams (Painlevé).
// Uniqueness is not claimed for large μ.
#include "physics/contact/solver/coulomb_solve.h"

#include <algorithm>
#include <limits>

#include "physics/contact/solver/coulomb_measures.h"

namespace hapticd {
namespace {

constexpr int longest_run_of_sweeps = 32;
constexpr int sweeps_between_checks = 4;
constexpr int sweeps_of_polish = 2;          // and of the first run, whose time they are judged by
constexpr int dear_steps = 8;                // LUs that the later stages are not begun without time for
constexpr double caution = 1.5;              // of the time that is predicted for them
constexpr int solves_raised = 20;            // that keep a raised diagonal …
constexpr int most_solves_raised = 320;      // … twice as many each time it is needed again, to this
constexpr double tolerance_of_rounds = 0.1;  // of the tolerance, that rounds are solved to
constexpr double worth_a_round = 0.5;        // of the last round's error left

constexpr CoulombStage stages[] = {
    {1, 0, true, 6}, {1, 1e-2, true, 8}, {1, 0, false, 8}, {10, 0, true, 8}, {100, 0, true, 8}};

}  // namespace

CoulombSolve::CoulombSolve(CoulombSystem& system, Eigen::Ref<VecX> lambda, CoulombWorkspace& ws,
                           const CoulombOptions& options, CoulombResult& result) noexcept
    : s_(system),
      lambda_(lambda),
      ws_(ws),
      options_(options),
      result_(result),
      rows_(3 * system.contacts),
      free_scale_(free_scale(system.q, system.rho.first(system.mu.size()), system.limit)),
      tolerance_(options.tolerance),
      most_sweeps_(options.max_sweeps),
      most_newton_(options.max_newton) {}

void CoulombSolve::run() noexcept {
  if (ws_.raised > 0 && options_.raised_diagonal > 0) {
    --ws_.raised;
    begin(options_.raised_diagonal);
  } else {
    begin(options_.relative_diagonal);
  }
  alternate();
  if (done() && may_raise() && result_.factorisations > 0) ws_.last_raised = 0;
  // What all of that has left unsolved is ill-posed as it stands; once more, on a softer problem.
  if (!done() && options_.raised_diagonal > 0 && !hurried_ && !options_.deadline.passed()) {
    raise(std::max(options_.raised_diagonal, 10 * s_.epsilon));
    most_sweeps_ += options_.max_sweeps;
    most_newton_ += options_.max_newton;
    alternate();
  }
  result_.relative_diagonal = s_.epsilon;
  if (done() && options_.raised_diagonal > 0 && !may_raise()) take_off_raised();
  if (!done()) polish();
  std::copy_n(done() ? ws_.best.data() : ws_.swept.data(), rows_, lambda_.data());
  if (done()) return;
  result_.residual = swept_residual_;
  result_.status =
      options_.deadline.passed() || hurried_ ? SolveStatus::deadline : SolveStatus::iteration_cap;
}

void CoulombSolve::alternate() noexcept {
  for (int length = 2; open(); length = std::min(2 * length, longest_run_of_sweeps)) {
    // The warm start did not serve.
    if (length == 4) {
      lambda_.setZero();
      s_.compute_delta(lambda_.data(), ws_.delta.data());
    }
    sweeps(length);
    for (const CoulombStage& stage : stages) {
      if (open() && (&stage == stages || affords(dear_steps))) newton(stage);
      if (open() && !affords(dear_steps)) hurried_ = true;
      if (open() && &stage != stages && may_raise() && result_.factorisations > 0 &&
          ws_.factor.jacobian.pivot_ratio() < hyperstatic)
        raise(options_.raised_diagonal);
    }
  }
}

// A raw step that is cut off at the cones has a wrong sum of forces, of whatever size its residual is; a
// sweep keeps the sum, and is in the cones.
void CoulombSolve::polish() noexcept {
  if (rough_) sweeps(sweeps_of_polish);
  while (!done() && result_.sweeps < most_sweeps_ && options_.deadline.bounded() &&
         options_.deadline.left() > ws_.polish_ns)
    sweeps(sweeps_of_polish);
}

void CoulombSolve::raise(double epsilon) noexcept {
  std::copy_n(ws_.best.data(), rows_, lambda_.data());
  begin(epsilon);
  // Sweeps alone hardly ever solve anything, which says nothing of the problem.
  const int again = options_.max_newton > 0 ? 2 : 1;
  ws_.last_raised = std::clamp(again * ws_.last_raised, solves_raised, most_solves_raised);
  ws_.raised = ws_.last_raised;
}

// From now on with this relative diagonal: another problem, with a best of its own.
void CoulombSolve::begin(double epsilon) noexcept {
  s_.epsilon = epsilon;
  std::fill_n(ws_.prepared.begin(), s_.contacts, std::uint8_t{0});
  result_.residual = swept_residual_ = std::numeric_limits<double>::infinity();
  for (int i = 0; i < s_.contacts; ++i) {
    Eigen::Map<Vec3> l(lambda_.data() + 3 * i);
    l = into_cone(l, s_.mu[i], s_.limit_of(i));
  }
  s_.compute_delta(lambda_.data(), ws_.delta.data());
  judge(true);
}

// What a raised ε adds to the gaps is taken off again, about the forces found: each round errs by ε times
// the last round's change (Rockafellar's proximal point iteration). A round begins at its own anchor, where
// ε adds nothing: if the problem is solved there, it is solved as it stands. Rounds end there, and where they
// gain little: then no forces of this size solve it. A round that ends unsolved is left out.
void CoulombSolve::take_off_raised() noexcept {
  if (!s_.anchor) std::fill_n(ws_.anchor.begin(), rows_, 0.0);
  s_.anchor = ws_.anchor.data();
  double last = std::numeric_limits<double>::infinity();
  for (int round = 0; round < options_.most_rounds && !hurried_ && !options_.deadline.passed(); ++round) {
    const CoulombResult reached = result_;
    std::copy_n(ws_.anchor.data(), rows_, ws_.last_anchor.data());
    std::copy_n(ws_.best.data(), rows_, ws_.anchor.data());
    std::copy_n(ws_.anchor.data(), rows_, lambda_.data());
    begin(s_.epsilon);
    const double as_it_stands = result_.residual;
    const bool serves = as_it_stands <= options_.tolerance;
    bool solved = false;
    tolerance_ = tolerance_of_rounds * options_.tolerance;
    if (!done() && as_it_stands < worth_a_round * last) {
      alternate();
      solved = done();
    }
    tolerance_ = options_.tolerance;
    if (solved) {
      last = as_it_stands;
      ++result_.rounds;
      continue;
    }
    std::copy_n(ws_.anchor.data(), rows_, ws_.best.data());
    if (serves) {
      result_.residual = as_it_stands;
      result_.relative_diagonal = 0;
    } else {
      std::copy_n(ws_.last_anchor.data(), rows_, ws_.anchor.data());
      result_.residual = reached.residual;
    }
    break;
  }
}

bool CoulombSolve::affords(int factors) const noexcept {
  const double ns = caution * factors * ws_.factor.flops * ws_.factor.ns_per_flop;
  return !options_.deadline.bounded() || ns < static_cast<double>(options_.deadline.left());
}

// λ of every contact into its cone; ws.delta follows.
void CoulombSolve::move_into_cones() noexcept {
  for (int i = 0; i < s_.contacts; ++i) {
    Eigen::Map<Vec3> l(lambda_.data() + 3 * i);
    const Vec3 change = into_cone(l, s_.mu[i], s_.limit_of(i)) - l;
    if (change.isZero(0)) continue;
    l += change;
    s_.add_contact(i, change, ws_.delta.data());
  }
}

double CoulombSolve::residual_of(const double* lambda, const double* delta) const noexcept {
  double scale = free_scale_;
  const double worst = natural_map(delta, lambda, s_.rho, s_.mu, s_.limit, scale);
  return relative_residual(worst, scale);
}

// λ at ws.delta = δ(λ): kept if it is the best so far, of all or of those that a sweep has left. What
// solves the problem from outside the cones has to solve it inside them too, for that is what is returned.
// True if λ was moved for that.
bool CoulombSolve::judge(bool swept) noexcept {
  double residual = residual_of(lambda_.data(), ws_.delta.data());
  const bool moves = !swept && residual <= tolerance_;
  if (moves) {
    move_into_cones();
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

void CoulombSolve::sweeps(int length) noexcept {
  const std::int64_t left = options_.deadline.left();
  for (int k = 1; k <= length && result_.sweeps < most_sweeps_; ++k) {
    sweep();
    ++result_.sweeps;
    const bool late = options_.deadline.passed();
    if (k != length && k % sweeps_between_checks != 0 && !late) continue;
    move_into_cones();
    // Rounding of many updates must not add up.
    if (k > sweeps_of_polish) s_.compute_delta(lambda_.data(), ws_.delta.data());
    judge(true);
    if (done() || late) break;
  }
  if (length == sweeps_of_polish) ws_.polish_ns = left - options_.deadline.left();
}

// One pass over the contacts; ws.delta follows λ.
void CoulombSolve::sweep() noexcept {
  for (int i = 0; i < s_.contacts; ++i) {
    Eigen::Map<Vec3> l(lambda_.data() + 3 * i);
    const Eigen::Map<const Vec3> d(ws_.delta.data() + 3 * i);
    if (d[0] >= 0 && l.isZero(0)) continue;
    Mat3 A = s_.W.block<3, 3>(3 * i, 3 * i);
    A.diagonal().array() += s_.diagonal(i);
    if (!ws_.prepared[i]) ws_.local[i] = CoulombContact(A, s_.mu[i], s_.limit_of(i));
    ws_.prepared[i] = 1;
    const Vec3 next = ws_.local[i].solve(d - A * l);
    const Vec3 change = next - l;
    if (change.isZero(0)) continue;
    l = next;
    s_.add_contact(i, change, ws_.delta.data());
  }
}

}  // namespace hapticd
