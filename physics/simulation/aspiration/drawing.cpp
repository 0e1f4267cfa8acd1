#include "physics/simulation/aspiration/drawing.h"

namespace hapticd {
namespace {

constexpr int most_solves = 5;  // of a step; what the last one throws is drawn all the same
constexpr double felt = 1e-6;   // by which a pull moves a tip, or what it draws [m]

EachInstrument<double> vacua(const InstrumentSamples& samples) {
  EachInstrument<double> vacuum;
  for (int i = 0; i < max_instruments; ++i) vacuum[i] = samples[i].vacuum;
  return vacuum;
}

bool is_felt(const CondensedProblem& problem, const PatchPositions& x_free_without) {
  for (const InstrumentReference& of : problem.instrument.value)
    if (of.coupling.stiffness > 0 && of.load.head<3>().norm() > felt * of.coupling.stiffness) return true;
  for (int n = 0; n < problem.nodes; ++n)
    if ((problem.x_free[n] - x_free_without[n]).squaredNorm() > felt * felt) return true;
  return false;
}

}  // namespace

EachInstrument<double> Drawing::begin(Instruments instruments, const InstrumentSamples& samples,
                                      const InstrumentPoses& X, const InstrumentPoses& next,
                                      CondensedProblem& problem) {
  solves_ = 1;
  const PatchPositions without = problem.x_free;
  const EachInstrument<double> occlusion =
      apply_suction(instruments, X, next, problem.x_now, vacua(samples), problem);
  if (!is_felt(problem, without)) {
    remove_suction(problem);
    problem.x_free = without;  // to the last bit
  }
  return occlusion;
}

bool Drawing::throws(Instruments instruments, const PatchPositions& x,
                     const CondensedProblem& problem) const {
  EachInstrument<Grip> grip = *grip_;
  return solves_ < most_solves && let_go(problem, instruments, problem.x_now, x, grip);
}

bool Drawing::again(Instruments instruments, const InstrumentSamples& samples, const InstrumentPoses& X,
                    const PatchPositions& x, CondensedProblem& problem, EachInstrument<double>& occlusion) {
  const EachInstrument<InstrumentReference> drawn = problem.instrument;
  const auto apply = [&](double share) {
    remove_suction(problem);
    occlusion = apply_suction(instruments, X, X, x, vacua(samples), problem, grip_.get(), share);
    for (int i = 0; i < max_instruments; ++i) problem.instrument[i].way = drawn[i].way;
  };
  if (++solves_ > most_solves) return false;
  const bool first = solves_ == 2;
  if (first) apply(1);
  const bool thrown = let_go(problem, instruments, problem.x_now, x, *grip_);
  if (thrown) apply(0);
  return first || thrown;
}

}  // namespace hapticd
