#include "physics/simulation/body_contact/body_contact_stage.h"

#include <algorithm>

#include "physics/simulation/body_contact/instrument_side.h"

namespace hapticd {
namespace {

constexpr int most_rounds = 16;
constexpr int most_attempts = 5;        // at finding the nodes that a fast step brings into touch
constexpr double settled_force = 1e-6;  // relative
constexpr double settled_gap = 1e-7;    // [m]

double relaxed(int round) { return round < 4 ? 1 : round < 8 ? 0.5 : 0.25; }

}  // namespace

void BodyContactStage::surface_changed(Bodies& bodies, int b) {
  contacts_.surface_changed(b);
  for (const ContactPair& p : contacts_.pairs())
    if (p.points == b || p.faces == b) bodies[p.points].asleep = bodies[p.faces].asleep = false;
}

void BodyContactStage::find(Bodies& bodies) {
  if (contacts_.empty()) return;
  contacts_.find(bodies);
  for (const ContactPair& p : contacts_.pairs()) {
    Body &a = bodies[p.points], &b = bodies[p.faces];
    if (!contacts_.touching(p.points, p.faces)) continue;
    if (a.deformable && a.asleep && b.deformable && !b.asleep && !at_rest(b)) a.asleep = false;
    if (b.deformable && b.asleep && a.deformable && !a.asleep && !at_rest(a)) b.asleep = false;
  }
}

void BodyContactStage::begin_solve(const StepContext& c, FactorStage& factors,
                                   const InstrumentSamples& samples, StepReport& report) {
  contacts_.set_domains(c.bodies, c.patch.nodes());
  for (int b = 0; b < c.body_count(); ++b) {
    const auto nodes = contacts_.domain_nodes(b);
    if (nodes.empty()) continue;
    factors.cover(c, b, samples, nodes, report);
    MatX& C = contacts_.compliance(b);
    C.resize(3 * static_cast<Eigen::Index>(nodes.size()), 3 * static_cast<Eigen::Index>(nodes.size()));
    c.bodies[b].compliance->patch(nodes, C);
  }
  contacts_.set_free_motion(c.bodies);
}

void BodyContactStage::solve_once(const StepContext& c, FactorStage& factors, InstrumentContact& contact,
                                  const InstrumentSamples& samples, const CondensedProblem& problem,
                                  const std::optional<EachInstrument<Vec6>>& last, StepReport& report) {
  if (!contacts_.any()) return contact.solve(c, samples, problem, last, report);
  begin_solve(c, factors, samples, report);
  VecX force = remembered_force(problem, contact.state.solver.memory);
  contacts_.solve(force);
  double off = contacts_.linearise(c.bodies);
  int round = 1;
  const bool reached = any_present(samples) && problem.samples > 0;
  if (!reached) {
    contact.solve(c, samples, problem, last, report);
    for (; round < most_rounds && off > settled_gap; ++round) {
      contacts_.relax(relaxed(round));
      contacts_.solve(force);
      off = contacts_.linearise(c.bodies);
    }
  } else {
    InstrumentSide tool(problem, c.instruments, poses_of(samples), c.settings.h,
                        contact_margin * problem.alarm_distance, contact.state.solver, contact.scratch());
    for (double change = 1; round < most_rounds && (change > settled_force || off > settled_gap); ++round) {
      contacts_.relax(relaxed(round));
      const VecX before = force;
      tool.linearise(contacts_);
      force = contacts_.solve_with(problem, contact.scratch().rows, tool.lambda);
      tool.follow(relaxed(round));
      off = contacts_.linearise(c.bodies);
      const double size = std::max(force.norm(), before.norm());
      change = size > 0 ? (force - before).norm() / size : 0;
    }
    report.contact = tool.finish(contacts_);
  }
  contact.state.patch_force = force;
  contacts_.report().rounds = round;
}

void BodyContactStage::predict_end(const StepContext& c, int b, const VecX& patch_force) {
  const Body& body = c.bodies[b];
  if (!is_awake(body)) return;
  x_end_[b] = body.state.x;
  VecX moved = force_on_body(body, b, c.patch.nodes(), patch_force);
  if (contacts_.any()) contacts_.add_forces(b, moved);
  if (!moved.isZero(0)) body.compliance->apply(moved, moved);
  for (std::size_t n = 0; n < x_end_[b].size(); ++n)
    x_end_[b][n] += body.free.dx.segment<3>(3 * static_cast<Eigen::Index>(n)) +
                    moved.segment<3>(3 * static_cast<Eigen::Index>(n));
}

// A step that takes a body into one that sleeps wakes it at once, or it would be hit like a wall.
void BodyContactStage::wake_touched(const StepContext& c, FactorStage& factors,
                                    const InstrumentSamples& samples) {
  for (const ContactPair& p : contacts_.pairs())
    for (const int b : {p.points, p.faces}) {
      Body& body = c.bodies[b];
      if (!body.deformable || !body.asleep || !contacts_.touching(p.points, p.faces)) continue;
      body.asleep = false;
      factors.follow(c, b, samples, {});
      body.compliance->update(body.state);
      compute_free_motion(body, c.settings.h);
      finish_free_motion(body, nullptr);
    }
}

void BodyContactStage::solve(const StepContext& c, FactorStage& factors, InstrumentContact& contact,
                             const InstrumentSamples& samples, const CondensedProblem& problem,
                             const std::optional<EachInstrument<Vec6>>& last, StepReport& report) {
  if (contacts_.empty()) return contact.solve(c, samples, problem, last, report);
  const ContactState before = contact.state.solver;
  x_end_.resize(c.bodies.size());
  for (int attempt = 0; attempt < most_attempts; ++attempt) {
    contact.state.solver = before;
    solve_once(c, factors, contact, samples, problem, last, report);
    for (const ContactPair& p : contacts_.pairs())
      for (const int b : {p.points, p.faces}) predict_end(c, b, contact.state.patch_force);
    const Positions end = [&](int b) {
      return std::span<const Vec3>(is_awake(c.bodies[b]) ? x_end_[b] : c.bodies[b].state.x);
    };
    if (attempt + 1 == most_attempts || contacts_.join_missed(c.bodies, end) == 0) break;
    wake_touched(c, factors, samples);
  }
  // Where all sleep, the forces of the last step hold them.
  if (report.awake_bodies > 0) contacts_.keep();
  report.body_contact = contacts_.report();
}

void BodyContactStage::condense(const Bodies& bodies, const VecX& patch_force, CondensedProblem& problem,
                                StepReport& report) {
  if (!contacts_.any()) return;
  report.body_contact = contacts_.report();
  contacts_.set_free_motion(bodies);
  // How deep the step left anything, before the next one is looked at.
  report.body_contact.penetration = contacts_.report().penetration;
  contacts_.solve(patch_force);
  if (problem.nodes == 0) return;
  contacts_.linearise(bodies);
  contacts_.solve(patch_force);
  contacts_.condense(problem);
}

}  // namespace hapticd
