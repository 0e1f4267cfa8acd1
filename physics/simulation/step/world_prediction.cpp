// The part of the step in which bodies are linearised where the instrument is about to take them
// (predicted_linearisation.h): for the middle of their problem's use; after a removal, when the problem is
// refreshed (world_refresh.cpp), for its begin.
#include <algorithm>
#include <cmath>

#include "physics/simulation/step/predicted_linearisation.h"
#include "physics/simulation/world.h"

namespace hapticd {
namespace {

constexpr double most_ahead = 0.5;    // in alarm distances: the patch is that of the pose it was gathered at
constexpr double first_use = 0.25;    // of a step, after the pose, of a problem that is refreshed
constexpr double part_of_way = 0.05;  // in alarm distances, that contact is solved on
constexpr double most_parts = 6;

}  // namespace

bool World::looks_ahead() const {
  return settings_.lead > 0 && settings_.contact == Renewal::renewed && settings_.fresh_free_motion &&
         contacts_.empty();
}

bool World::foresees(const Body& body) const {
  return looks_ahead() && body.free.in_halves && body.model.corotational &&
         body.model.material.law != Law::guarded;
}

Pose World::pose_ahead(const Pose& X) const {
  const Vec6 way = settings_.lead * twist_;
  const double most = most_ahead * settings_.alarm_distance;
  return displaced(X, std::min(1.0, most / std::max(way.head<3>().norm(), 1e-12)) * way);
}

// Nothing of this solve is remembered but what it foresees. A thin piece that a removal left may give way to
// either side of the instrument, or be held by friction: it is met on the way, from where the problem was
// made.
ContactSolution World::solve_ahead(const Pose& X, const CondensedProblem& problem) {
  ContactState state = contact_state_;
  const Vec6 way = difference(X, problem.X_ref);
  const double parts =
      removing_
          ? std::min(std::ceil(way.head<3>().norm() / (part_of_way * settings_.alarm_distance)), most_parts)
          : 1;
  for (int p = 1; p < parts; ++p)
    solve_contact(problem, *instrument_, displaced(problem.X_ref, p / parts * way), settings_.h,
                  contact_options(), state, *ahead_scratch_);
  return solve_contact(problem, *instrument_, X, settings_.h, contact_options(), state, *ahead_scratch_);
}

void World::predict_linearisation(const InstrumentSample& sample, CondensedProblem& problem,
                                  StepReport& report) {
  InstrumentSample there = sample;
  there.pose = pose_ahead(sample.pose);
  ContactSolution contact;
  if (sample.present) {
    const Within solve(times(), StepPart::solve);
    const double share = removing_ ? std::min(1.0, first_use * settings_.h / settings_.lead) : 1;
    contact = solve_ahead(displaced(sample.pose, share * difference(there.pose, sample.pose)), problem);
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
    if (body.energy.bounded_steps > 0 || !can_predict_linearisation(body)) {
      if (foresees(body)) fresh_free_motion(body, settings_.h);
      if (!touched || foresees(body)) continue;
      body.compliance->apply(contact_force_, contact_force_);
      body.free.dx -= contact_force_;
      continue;
    }
    if (sample.present) update_zone(static_cast<int>(b), there, of_body);
    linearise_ahead(body, settings_.h);
    ahead_[b] = 1;
    if (free_motion_plausible(body)) continue;
    make_reference(static_cast<int>(b), report);
    body.free.dx = body.free.predicted;
    linearise_ahead(body, settings_.h);
  }
  compliance_of_patch(sample, problem, report);
  place_patch(problem);
}

}  // namespace hapticd
