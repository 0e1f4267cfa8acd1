// Modes of the contact solver: many contacts that conform to a flat tool, contacts that are there three
// times.
//
// The sequences are the chart of contact solvers' (contact_sequence.h): the reference solves to 1e-10, both
// methods start from their own last answer. What is judged is the wrench, for the single forces of redundant
// contacts are nobody's.
#include <algorithm>
#include <memory>

#include "physics/contact/coulomb.h"
#include "tools/contact_sequence.h"
#include "tools/peer_solver.h"
#include "tools/stability_bench.h"

namespace hapticd {

namespace {

constexpr int naive_sweeps = 30;  // what a millisecond has time for at a hundred contacts
constexpr int our_sweeps = 50;    // as the daemon's haptic loop
constexpr double usable = 1e-3;   // a residual above it is not rendered
constexpr double tight = 1e-10;

// The largest error of the wrench over a stroke, where the wrench is a hundredth of the largest or more.
class Against {
 public:
  explicit Against(const ContactSequence& sequence) : sequence_(sequence) {}
  void add(const VecX& lambda, const VecX& reference, double t, StabilityTrial& trial) {
    const Vec6 right = sequence_.wrench(reference);
    const double length = sequence_.length(right);
    largest_ = std::max(largest_, length);
    trial.trace.emplace_back(t, sequence_.length(sequence_.wrench(lambda)));
    if (length < 0.01 * largest_) return;
    trial.judged = std::max(trial.judged, 100 * sequence_.length(sequence_.wrench(lambda) - right) /
                                              std::max(length, 0.1 * largest_));
  }

 private:
  const ContactSequence& sequence_;
  double largest_ = 0;
};

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
  Against against(sequence);
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
      if (r.status != SolveStatus::solved && r.residual > usable) trial.says = "solver cap";
    }
    against.add(lambda, reference, 1e-3 * step, trial);
  }
  return trial;
}

StabilityPlan plan_solver(ContactCase kind, bool quick) {
  StabilityPlan plan;
  plan.naive = "projected Gauss-Seidel, 30 sweeps, warm";
  plan.ours = "the haptic loop's solver with its cap of 50 sweeps";
  plan.judged = "largest error of the wrench [%]";
  plan.limit = 5;  // a little below the least difference of force that hands tell: 7 % (Jones 1989)
  plan.trace_y = "length of the wrench [N]";
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
