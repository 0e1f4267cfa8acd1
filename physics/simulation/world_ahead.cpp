// The part of the step in which bodies are linearised where the instrument is about to take them
// (look_ahead.h).
#include <algorithm>

#include "physics/simulation/look_ahead.h"
#include "physics/simulation/world.h"

namespace hapticd {
namespace {

constexpr double most_ahead = 0.5;  // in alarm distances: the patch is that of the pose it was gathered at

}  // namespace

bool World::looks_ahead() const {
  return settings_.lead > 0 && settings_.contact == Renewal::renewed && settings_.fresh_free_motion &&
         contacts_.empty();
}

bool World::foresees(const Body& body) const {
  return looks_ahead() && body.in_halves && body.model.corotational &&
         body.model.material.law != Law::guarded;
}

Pose World::pose_ahead(const Pose& X) const {
  const Vec6 way = settings_.lead * twist_;
  const double most = most_ahead * settings_.alarm_distance;
  return displaced(X, std::min(1.0, most / std::max(way.head<3>().norm(), 1e-12)) * way);
}

void World::look_ahead(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report) {
  InstrumentSample there = sample;
  there.pose = pose_ahead(sample.pose);
  ContactSolution contact;
  if (sample.present) {
    const Within solve(times(), StepPart::solve);
    // Nothing of this solve is remembered but what it foresees.
    ContactState state = contact_state_;
    contact = solve_contact(problem, *instrument_, there.pose, settings_.h, contact_options(), state,
                            *ahead_scratch_);
  }
  const bool pressed = sample.present && usable(contact);
  const VecX force = pressed ? force_on_patch(problem, *ahead_scratch_) : VecX::Zero(3 * problem.nodes);
  const auto nodes = gatherer_.nodes();
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    Body& body = bodies_[b];
    if (!body.deformable || body.asleep || !body.model.corotational) continue;
    contact_force_.setZero(3 * body.model.node_count());
    std::vector<int> of_body;
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      if (nodes[i].body != static_cast<int>(b)) continue;
      of_body.push_back(nodes[i].node);
      contact_force_.segment<3>(3 * nodes[i].node) += force.segment<3>(3 * static_cast<Eigen::Index>(i));
    }
    const bool touched = !contact_force_.isZero(0);
    {
      const Within free_motion(times(), StepPart::free_motion);
      finish_free_motion(body, touched ? &contact_force_ : nullptr);
    }
    if (!can_look_ahead(body)) {
      if (foresees(body)) fresh_free_motion(body, settings_.h);
      if (!touched || foresees(body)) continue;
      body.compliance->apply(contact_force_, contact_force_);
      body.dx_free -= contact_force_;
      continue;
    }
    if (sample.present) update_zone(static_cast<int>(b), there, of_body);
    linearise_ahead(body, settings_.h);
    ahead_[b] = 1;
    if (believed(body)) continue;
    make_base(static_cast<int>(b), report);
    body.dx_free = body.dx_ahead;
    linearise_ahead(body, settings_.h);
  }
  compliance_of_patch(sample, problem, report);
  place_patch(problem);
}

}  // namespace hapticd
