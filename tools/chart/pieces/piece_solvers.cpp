#include "tools/chart/pieces/piece_solvers.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <numbers>

#include "physics/contact/solver/coulomb.h"
#include "tools/chart/pieces/stirred_scene.h"
#include "tools/chart/solver/pgs_baseline.h"
#include "tools/chart/solver/sap_baseline.h"

namespace hapticd {
namespace {

constexpr double closed_gap = 1e-9;  // [m], as the step's
constexpr double asked = 1e-6;       // residual
constexpr int times_each = 3;
constexpr double sap_tight = 5e-7, sap_soft = 1 / (4 * std::numbers::pi * std::numbers::pi);

double now_us() {
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

// Solves from λ and leaves the answer there; whether it calls that solved.
using Solver = std::function<bool(const JointProblem& problem, VecX& lambda, const Deadline& deadline)>;

bool ours(const JointProblem& p, VecX& lambda, const Deadline&) {
  if (p.mu.empty()) {
    LcpWorkspace workspace(p.touches());
    std::vector<std::uint8_t> active(lambda.size());
    for (Eigen::Index i = 0; i < lambda.size(); ++i) active[i] = lambda[i] > 0;
    return solve_lcp(p.W, p.q, lambda, active, workspace, 0, LcpOptions{}).status == SolveStatus::solved;
  }
  CoulombWorkspace workspace(p.touches(), false);
  CoulombOptions options;
  options.tolerance = 1e-10;
  CoulombResult r = solve_coulomb(p.W, p.q, p.mu, lambda, workspace, 0, options);
  if (!(r.residual <= CoulombOptions{}.tolerance)) {
    options.max_sweeps = 2000;
    r = solve_coulomb(p.W, p.q, p.mu, lambda, workspace, 0, options);
  }
  return r.residual <= CoulombOptions{}.tolerance;
}

Solver sap(double relative_diagonal) {
  return [relative_diagonal](const JointProblem& p, VecX& lambda, const Deadline& deadline) {
    SapOptions options;
    options.relative_diagonal = relative_diagonal;
    options.deadline = deadline;
    return solve_sap(p.W, p.q, p.mu, lambda, options).solved;
  };
}

bool pgs(const JointProblem& p, VecX& lambda, const Deadline& deadline) {
  return solve_projected(p.W, p.q, p.mu, lambda, 0.5 * asked, 1 << 20, deadline).solved;
}

struct Entrant {
  const char* name;
  Solver solve;
};
const std::vector<Entrant>& entrants() {
  static const std::vector<Entrant> all = {
      {"ours", ours}, {"sap", sap(sap_tight)}, {"sap_soft", sap(sap_soft)}, {"pgs", pgs}};
  return all;
}

// Leaves the answer in the problem's own λ.
bool solve_growing(JointProblem& p, const Solver& solve, const Deadline& deadline) {
  const int m = p.width();
  std::vector<int> working;
  std::vector<std::uint8_t> works(p.touches(), 0);
  VecX delta = p.q;
  bool solved = true;
  for (bool more = true; more && solved && !deadline.passed();) {
    more = false;
    for (int i = 0; i < p.touches(); ++i) {
      if (works[i] || delta[m * i] >= (working.empty() ? 0 : -closed_gap)) continue;
      works[i] = more = true;
    }
    if (!more) return true;
    working.clear();
    for (int i = 0; i < p.touches(); ++i)
      if (works[i]) working.push_back(i);
    JointProblem part = part_of(p, working);
    solved = solve(part, part.lambda, deadline);
    for (std::size_t k = 0; k < working.size(); ++k)
      p.lambda.segment(m * working[k], m) = part.lambda.segment(m * static_cast<Eigen::Index>(k), m);
    delta.noalias() = p.W * p.lambda;
    delta += p.q;
  }
  return solved && !deadline.passed();
}

struct Tally {
  std::vector<double> us, residual;
  int failures = 0, unfinished = 0, active = 0;
};

struct Answer {
  double us = 0, residual = 0;
  bool solved = false;
  int active = 0;
};

Answer run(const Entrant& e, JointProblem p, double budget_us) {
  Answer out;
  for (int k = 0; k < times_each && out.us < 0.1 * budget_us; ++k) {
    p.lambda.setZero();
    const double begun = now_us(), until = begun + budget_us;
    const Deadline deadline{
        [](const void* at) noexcept {
          return static_cast<std::int64_t>(1e3 * (*static_cast<const double*>(at) - now_us()));
        },
        &until};
    out.solved = solve_growing(p, e.solve, deadline);
    const double us = now_us() - begun;
    out.us = k == 0 ? us : std::min(out.us, us);
    out.residual = residual_of(p, p.lambda);
    out.active = 0;
    for (int i = 0; i < p.touches(); ++i) out.active += p.lambda[p.width() * i] > 0;
  }
  return out;
}

}  // namespace

std::vector<JointProblem> capture_joint_problems(const Scene& scene, const PieceSolverSettings& settings,
                                                 const std::function<bool(double)>& progress) {
  StirSettings stirring;
  stirring.steps = settings.steps;
  stirring.seed = settings.seed;
  stirring.look = settings.steps + 1;
  const int every = std::max(1, settings.steps / settings.problems);
  std::vector<JointProblem> out;
  int step = 0;
  bool due = false;
  stir(scene, stirring, progress,
       [&](const World& world, const CondensedProblem& published, const StepReport& r) {
         due = due || ++step % every == 0;
         if (!due) return;
         if (auto p = joint_problem(world, published, r)) {
           out.push_back(std::move(*p));
           due = false;
         }
       });
  return out;
}

std::vector<PieceSolverPoint> compare_solvers(const std::string& scene,
                                              const std::vector<JointProblem>& problems,
                                              const PieceSolverSettings& settings,
                                              const std::function<bool(double)>& progress) {
  std::map<std::tuple<bool, int, int>, Tally> tallies;  // friction, touches, entrant
  for (std::size_t k = 0; k < problems.size(); ++k) {
    for (const int size : settings.touches) {
      if (problems[k].touches() < size) continue;
      const JointProblem p = nearest_touches(problems[k], size);
      for (std::size_t e = 0; e < entrants().size(); ++e) {
        const Answer a = run(entrants()[e], p, e == 0 ? 1e9 : settings.budget_us);
        Tally& t = tallies[{!p.mu.empty(), size, static_cast<int>(e)}];
        t.us.push_back(a.us);
        t.residual.push_back(a.residual);
        t.failures += !(a.residual <= asked);
        t.unfinished += !a.solved;
        t.active = std::max(t.active, a.active);
      }
    }
    if (progress && !progress(static_cast<double>(k + 1) / static_cast<double>(problems.size()))) break;
  }
  std::vector<PieceSolverPoint> out;
  for (const auto& [key, t] : tallies) {
    const auto& [friction, size, e] = key;
    out.push_back({entrants()[e].name, scene, size, friction, static_cast<int>(t.us.size()), t.active,
                   quantiles(t.us), quantiles(t.residual), t.failures, t.unfinished});
  }
  return out;
}

}  // namespace hapticd
