#include "physics/simulation/step/prediction.h"

#include <algorithm>
#include <cmath>

#include "physics/contact/missed_contact.h"
#include "physics/simulation/step/instrument_contact.h"
#include "physics/simulation/step/predicted_linearisation.h"

namespace hapticd {
namespace {

constexpr double most_ahead = 0.5;    // in alarm distances: the patch is that of the pose it was gathered at
constexpr double first_use = 0.25;    // of a step, after the pose, of a problem that is refreshed
constexpr double part_of_way = 0.05;  // in alarm distances, that contact is solved on
constexpr double most_parts = 6;
constexpr int linearisations = 2;  // of contact: it says where bodies are linearised, and no more

// Whether it can be linearised where `force` takes it. With tissue inside out it is linearised as it stands,
// if each step makes its factor: the next would make that same one. Not so after a motion that made energy:
// a hand that hardly keeps still swings sooner then.
bool foresee_body(FactorStage& factors, Body& body, VecX force, double h) {
  const bool touched = !force.isZero(0);
  {
    const Within free_motion(body.times, StepPart::free_motion);
    finish_free_motion(body, touched ? &force : nullptr);
  }
  const bool keeps_energy = body.energy.bounded_steps == 0;
  if (keeps_energy && can_predict_linearisation(body)) return true;
  if (keeps_energy && !body.references && body.model.material.law != Law::guarded) {
    body.free.dx.setZero();
    return true;
  }
  if (factors.foresees(body)) fresh_free_motion(body, h);
  if (!touched || factors.foresees(body)) return false;
  body.compliance->apply(force, force);
  body.free.dx -= force;
  return false;
}

Pose pose_ahead(const StepContext& c, int i, const Pose& X) {
  const Vec6 way = c.settings.lead * c.motion[i].twist();
  const double most = most_ahead * c.settings.alarm_distance;
  return displaced(X, std::min(1.0, most / std::max(way.head<3>().norm(), 1e-12)) * way);
}

InstrumentSamples samples_ahead(const StepContext& c, const InstrumentSamples& samples) {
  InstrumentSamples there = samples;
  for (int i = 0; i < max_instruments; ++i) there[i].pose = pose_ahead(c, i, samples[i].pose);
  return there;
}

}  // namespace

Prediction::Prediction(const WorldSettings& settings) {
  if (predicts(settings)) scratch_ = std::make_unique<ContactScratch>();
}

ContactSolution Prediction::solve(const StepContext& c, const CondensedProblem& problem,
                                  const InstrumentPoses& X, const ContactState& before, bool on_the_way) {
  ContactState state = before;
  const double h = c.settings.h;
  InstrumentPoses from = X;
  for (int i = 0; i < max_instruments; ++i)
    if (X.present[i]) from[i] = problem.instrument[i].X_ref;
  const EachInstrument<Vec6> way = difference(X, from);
  const double parts = on_the_way ? std::min(std::ceil(longest_in_reach(problem, c.instruments, X, way) /
                                                       (part_of_way * c.settings.alarm_distance)),
                                             most_parts)
                                  : 1;
  ContactOptions options = contact_options(c.settings);
  options.parts = std::max(1.0, parts);
  options.linearisations = std::min(options.linearisations, linearisations);
  options.coulomb.most_rounds = 0;
  for (int p = 1; p < parts; ++p)
    solve_contact(problem, c.instruments, displaced(from, way, p / parts), h, options, state, *scratch_);
  return solve_contact(problem, c.instruments, X, h, options, state, *scratch_);
}

VecX Prediction::force(const CondensedProblem& problem) const {
  return force_on_patch(problem, *scratch_) + pull_on_patch(problem);
}

std::vector<int> Prediction::foresee(const StepContext& c, FactorStage& factors,
                                     const CondensedProblem& problem, const InstrumentSamples& samples,
                                     const ContactState& before, bool removing) {
  VecX patch_force = VecX::Zero(3 * problem.nodes);
  const InstrumentPoses here = poses_of(samples);
  if (here.any()) {
    const Within solving(c.times(), StepPart::solve);
    const double share = removing ? std::min(1.0, first_use * c.settings.h / c.settings.lead) : 1;
    const InstrumentPoses there = poses_of(samples_ahead(c, samples));
    const InstrumentPoses X = displaced(here, difference(there, here), share);
    if (usable(solve(c, problem, X, before, removing))) patch_force = force(problem);
  }
  std::vector<int> foreseen;
  for (int b = 0; b < c.body_count(); ++b)
    if (is_awake(c.bodies[b]) && c.bodies[b].model.corotational &&
        foresee_body(factors, c.bodies[b], force_on_body(c.bodies[b], b, c.patch.nodes(), patch_force),
                     c.settings.h))
      foreseen.push_back(b);
  return foreseen;
}

void Prediction::linearise(const StepContext& c, FactorStage& factors, int b,
                           const InstrumentSamples& samples, StepReport& report) const {
  Body& body = c.bodies[b];
  const double h = c.settings.h;
  if (any_present(samples)) factors.follow(c, b, samples_ahead(c, samples), c.patch.nodes_of(b));
  linearise_ahead(body, h);
  body.free.ahead = true;
  if (factors.plausible(c, body)) return;
  factors.make_reference(c, b, report);
  body.free.dx = body.free.predicted;
  linearise_ahead(body, h);
}

}  // namespace hapticd
