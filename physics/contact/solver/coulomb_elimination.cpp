// Steps of the Coulomb solver that eliminate the contacts which stick (sticking_elimination.h) and solve what
// is left to the law, by sweeps and Newton as ever. Where a contact's direction of slip turns far, Newton on
// all contacts crawls, each step with a factor of all unknowns: 30 to 100 on a flat tip. Here the crawl is in
// the small problem. A contact that does not stick in the solution, or an open one that penetrates, joins the
// others; it does not go back, so this ends.
#include <algorithm>
#include <cmath>

#include "physics/contact/solver/coulomb_measures.h"
#include "physics/contact/solver/coulomb_solve.h"

namespace hapticd {
namespace {

constexpr int most_eliminations = 8;
constexpr double surely = 0.95;       // of the cone, within which a contact is presumed to stick
constexpr int most_others = 5;        // to one that sticks: beyond, what is left is as hard as the whole
constexpr int most_within = 16;       // sweeps, and Newton steps, of what is left …
constexpr double precise = 1e-2;      // … to this part of the residual before …
constexpr double most_precise = 0.1;  // … or of the tolerance

enum class Presumed : std::uint8_t { open, sticking, other };

// By y = λ − ρ δ, as Newton sorts.
Presumed presumed(const double* l, const double* d, double rho, double mu) noexcept {
  const double n = l[0] - rho * d[0];
  if (!(n > 0)) return Presumed::open;
  const double y1 = l[1] - rho * d[1], y2 = l[2] - rho * d[2], most = surely * mu * n;
  return y1 * y1 + y2 * y2 <= most * most && mu > 0 ? Presumed::sticking : Presumed::other;
}

}  // namespace

// Lists of those that stick and of the others. The lists of a factor that is kept serve as long as what it
// eliminates may stick. False if too few stick.
bool CoulombSolve::sort_for_elimination() noexcept {
  CoulombElimination& e = ws_.elimination.front();
  const auto presumed_of = [&](int i) {
    return e.other[i] ? Presumed::other
                      : presumed(lambda_.data() + 3 * i, ws_.delta.data() + 3 * i, s_.rho[i], s_.mu[i]);
  };
  if (e.sticking.kept(s_)) {
    int wanted = 0;
    for (int i = 0; i < s_.contacts; ++i) wanted += presumed_of(i) != Presumed::open;
    const auto sticks = [&](int i) { return presumed_of(i) == Presumed::sticking; };
    const auto& R = e.sticking.sticking();
    const auto& P = e.sticking.others();
    for (const int i : P) wanted -= presumed_of(i) != Presumed::open;
    if (wanted == static_cast<int>(R.size()) && std::all_of(R.begin(), R.end(), sticks)) return true;
  }
  e.sticking.clear();
  for (int i = 0; i < s_.contacts; ++i) {
    const Presumed how = presumed_of(i);
    if (how != Presumed::open) e.sticking.take(i, how == Presumed::sticking);
  }
  const auto stick = e.sticking.sticking().size();
  return stick > 0 && e.sticking.others().size() <= most_others * stick;
}

// λ of the others, for the lists as they are, and with it λ and δ of all. False where there is no factor.
bool CoulombSolve::solve_others(const Deadline& deadline) noexcept {
  CoulombElimination& e = ws_.elimination.front();
  e.sticking.reduce(s_);
  const auto others = e.sticking.others();
  const auto count = others.size();
  for (std::size_t k = 0; k < count; ++k) {
    e.mu[k] = s_.mu[others[k]];
    e.limit[k] = s_.limit_of(others[k]);
    std::copy_n(lambda_.data() + 3 * others[k], 3, e.lambda.data() + 3 * k);
  }
  if (count > 0) {
    CoulombOptions options = options_;
    options.tolerance = std::max(most_precise * tolerance_, precise * std::min(1.0, result_.residual));
    options.relative_diagonal = options.raised_diagonal = 0;  // S has ε in it
    options.max_sweeps = options.max_newton = most_within;
    options.deadline = deadline;
    options.columns = {};
    Eigen::Map<VecX> lambda(e.lambda.data(), 3 * static_cast<Eigen::Index>(count));
    const std::span<const double> limit = {e.limit.data(), s_.limit.empty() ? 0 : count};
    const CoulombResult r = solve_coulomb(e.sticking.S(), e.sticking.q(), {e.mu.data(), count}, lambda,
                                          e.workspace, 0, options, limit);
    if (r.status == SolveStatus::not_finite) return false;
  }
  e.sticking.recover(e.lambda.data(), {lambda_.data(), static_cast<std::size_t>(rows_)});
  s_.compute_delta(lambda_.data(), ws_.delta.data());
  return true;
}

void CoulombSolve::eliminate() noexcept {
  if (ws_.elimination.empty()) return;
  CoulombElimination& e = ws_.elimination.front();
  const Deadline deadline = before_polish();
  std::fill_n(e.other.begin(), s_.contacts, std::uint8_t{0});
  s_.stretch = 1;
  double merit = merit_here();
  std::copy_n(lambda_.data(), rows_, ws_.turning_point.data());
  for (int k = 0; k < most_eliminations && !done() && result_.newton < most_newton_; ++k) {
    if (deadline.passed() || !sort_for_elimination()) break;
    ++result_.newton;
    if (!e.sticking.kept(s_)) {
      if (deadline.bounded() &&
          e.sticking.flops() * ws_.factor.ns_per_flop > static_cast<double>(deadline.left()))
        break;
      ++result_.factorisations;
      if (!e.sticking.factor(s_)) break;
    }
    // Their forces would be anything; Newton's stages raise ε if it must be.
    if (e.sticking.pivot_ratio() < hyperstatic && may_raise()) break;
    if (!solve_others(deadline)) break;
    for (const int i : e.sticking.others()) e.other[i] = 1;
    for (int i = 0; i < s_.contacts; ++i) {
      const double* l = lambda_.data() + 3 * i;
      const bool in_cone = l[0] >= 0 && std::hypot(l[1], l[2]) <= s_.mu[i] * l[0];
      const bool penetrates = l[0] == 0 && ws_.delta[3 * i] < 0;
      if (!in_cone || penetrates) e.other[i] = 1;
    }
    judge(false);
  }
  if (!done() && !(merit_here() < merit)) put_back(ws_.turning_point.data());
}

}  // namespace hapticd
