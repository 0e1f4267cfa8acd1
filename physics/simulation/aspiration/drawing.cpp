#include "physics/simulation/aspiration/drawing.h"

namespace hapticd {
namespace {

constexpr int most_solves = 5;  // of a step; what the last one throws is drawn all the same

EachInstrument<double> vacua(const InstrumentSamples& samples) {
  EachInstrument<double> vacuum;
  for (int i = 0; i < max_instruments; ++i) vacuum[i] = samples[i].vacuum;
  return vacuum;
}

}  // namespace

EachInstrument<double> Drawing::begin(Instruments instruments, const InstrumentSamples& samples,
                                      const InstrumentPoses& X, const InstrumentPoses& next,
                                      CondensedProblem& problem) {
  solves_ = 1;
  return apply_suction(instruments, X, next, problem.x_now, vacua(samples), problem);
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
