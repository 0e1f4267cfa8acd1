// Modes of the contact solver: many contacts that conform to a flat tool, contacts that are there three
// times.
//
// The sequences are the chart of contact solvers' (contact_sequence.h), led by a reference that solves to
// 1e-10; both methods start from their own last answer.
#include <algorithm>
#include <memory>

#include "physics/contact/solver/coulomb.h"
#include "tools/chart/solver/contact_sequence.h"
#include "tools/chart/solver/pgs_baseline.h"
#include "tools/stability/stability_plans.h"

namespace hapticd {

namespace {

constexpr int naive_sweeps = 10;  // what games and many haptic programs give it
constexpr int our_sweeps = 50;    // as the daemon's haptic loop
constexpr double usable = 1e-3;   // a residual above it is not rendered (haptic_step.h)
constexpr double tight = 1e-10;

StabilityTrial solve_sequence(ContactCase kind, int contacts, int steps, bool naive) {
  SequenceSettings settings;
  settings.kind = kind;
  settings.contacts = contacts;
  ContactSequence sequence(settings);
  const auto space = std::make_unique<CoulombWorkspace>(),
             reference_space = std::make_unique<CoulombWorkspace>();
  CoulombOptions ours, exact;
  ours.max_sweeps = our_sweeps;
  exact.tolerance = tight;
  VecX reference, lambda;
  StabilityTrial trial;
  for (int step = 0; step < steps; ++step) {
    sequence.advance(reference);
    if (step == 0) reference = lambda = VecX::Zero(sequence.rows());
    sequence.carry(reference);
    sequence.carry(lambda);
    solve_coulomb(sequence.W(), sequence.q(), sequence.mu(), reference, *reference_space, sequence.version(),
                  exact);
    if (naive) {
      solve_projected(sequence.W(), sequence.q(), sequence.mu(), lambda, 0, naive_sweeps, {});
    } else {
      const CoulombResult r =
          solve_coulomb(sequence.W(), sequence.q(), sequence.mu(), lambda, *space, sequence.version(), ours);
      if (r.status != SolveStatus::solved) trial.says = "solver cap";
    }
    const double residual = coulomb_residual(sequence.W(), sequence.q(), lambda, sequence.mu());
    trial.judged = std::max(trial.judged, residual);
    trial.trace.emplace_back(1e-3 * step, std::max(residual, 1e-12));
  }
  return trial;
}

StabilityPlan plan_solver(ContactCase kind, bool quick) {
  StabilityPlan plan;
  plan.naive = "projected Gauss-Seidel, 10 sweeps, warm";
  plan.ours = "the haptic loop's solver with its cap of 50 sweeps";
  plan.judged = "largest residual of a stroke (natural map)";
  plan.limit = usable;
  plan.trace_y = "residual";
  const int steps = quick ? 250 : 500;
  plan.run_naive = [=](double n) { return solve_sequence(kind, static_cast<int>(n), steps, true); };
  plan.run_ours = [=](double n) { return solve_sequence(kind, static_cast<int>(n), steps, false); };
  return plan;
}

}  // namespace

StabilityPlan plan_conforming(StabilityBench&, bool quick) {
  StabilityPlan plan = plan_solver(ContactCase::flat, quick);
  plan.parameter = "contacts of a flat punch on a block, with friction";
  plan.reason = "100: all that a problem can hold";
  plan.required = 100;
  plan.values = quick ? std::vector<double>{30, 100} : std::vector<double>{4, 10, 20, 30, 50, 70, 100};
  return plan;
}

StabilityPlan plan_duplicated(StabilityBench&, bool quick) {
  StabilityPlan plan = plan_solver(ContactCase::duplicates, quick);
  plan.parameter = "contacts, each point three times, with friction";
  plan.reason = "99: all that a problem can hold";
  plan.required = 99;
  plan.values = quick ? std::vector<double>{30, 99} : std::vector<double>{6, 9, 18, 30, 51, 72, 99};
  return plan;
}

}  // namespace hapticd
