#include "physics/simulation/step/instrument_contact.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "physics/contact/missed_contact.h"
#include "physics/contact/suction.h"
#include "physics/simulation/body_contact/velocity_bound.h"

namespace hapticd {
namespace {

constexpr double far_step = 0.6;     // in alarm distances
constexpr double most_parts = 32;    // of a step's way that contact is solved on
constexpr double turned = 1e-3;      // by which forces may have, where a solve goes on from another [rad]
constexpr double near_enough = 0.3;  // of the margin, to be a row there from the begin

void know(const ContactState& contact, CondensedProblem& problem) {
  problem.known = contact.memory;
  for (int i = 0; i < max_instruments; ++i) problem.instrument[i].offset = contact.coupling_offset[i];
}

}  // namespace

ContactOptions contact_options(const WorldSettings& settings) {
  ContactOptions options;
  options.linearisations = settings.linearisations;
  options.coulomb = settings.coulomb;
  options.margin = settings.contact == Renewal::frozen ? 0 : contact_margin * settings.alarm_distance;
  options.activation_distance = near_enough * options.margin;
  return options;
}

VecX force_on_patch(const CondensedProblem& problem, const ContactScratch& scratch) {
  const ContactRows& rows = scratch.rows;
  VecX f = VecX::Zero(3 * problem.nodes);
  for (int i = 0; i < rows.contacts; ++i) {
    const NodeWeights at = node_weights(problem, rows.row[i]);
    Vec3 force = scratch.lambda[rows.rows_per_contact * i] * rows.row[i].frame.col(0);
    for (int t = 1; t < rows.rows_per_contact; ++t)
      force += scratch.lambda[rows.rows_per_contact * i + t] * rows.row[i].frame.col(t);
    for (std::size_t c = 0; c < at.node.size(); ++c) f.segment<3>(3 * at.node[c]) += at.weight[c] * force;
  }
  return f;
}

VecX pull_on_patch(const CondensedProblem& problem) {
  VecX f(3 * problem.nodes);
  for (int n = 0; n < problem.nodes; ++n) f.segment<3>(3 * n) = problem.pull[n];
  return f;
}

VecX remembered_force(const CondensedProblem& problem, const ContactMemory& memory) {
  VecX f = VecX::Zero(3 * problem.nodes);
  for (int k = 0; k < problem.samples; ++k) {
    const PatchSample& s = problem.sample[k];
    if (s.node[0] < 0) continue;
    const Vec3 force = memory.force_on(s.id);
    for (int c = 0; c < 3; ++c) f.segment<3>(3 * s.node[c]) += s.weight[c] * force;
  }
  for (int k = 0; k < problem.edges; ++k) {
    const EdgeSample& e = problem.edge[k];
    const Vec3 force = memory.force_on(e.id);
    for (int c = 0; c < 4; ++c) f.segment<3>(3 * e.node[c]) += e.weight[c] * force;
  }
  return f;
}

int correct_bodies(const StepContext& c, const VecX& patch_force, std::span<const VecX> responses) {
  int bounded = 0;
  for (int b = 0; b < c.body_count(); ++b) {
    Body& body = c.bodies[b];
    if (!is_awake(body)) continue;
    body.free.ahead = false;
    VecX force = force_on_body(body, b, c.patch.nodes(), patch_force);
    const std::span<const int> near = c.contacts.nodes_of(b);
    if (c.contacts.any() && c.contacts.pushes(b)) c.contacts.add_forces(b, force);
    const bool known = !responses.empty() && responses[b].size() > 0 && !force.isZero(0);
    const VecX* response = known ? &responses[b] : nullptr;
    if (!near.empty() && c.settings.keeps_energy && body.model.dynamic)
      correct_touching(body, force, near, c.settings.h, response);
    else
      correct(body, force.isZero(0) ? nullptr : &force, c.settings.h, c.settings.keeps_energy, response);
    bounded += body.energy.bounded_steps > 0;
  }
  return bounded;
}

InstrumentContact::InstrumentContact(double sample_spacing)
    : gatherer_(sample_spacing),
      scratch_(std::make_unique<ContactScratch>()),
      published_scratch_(std::make_unique<ContactScratch>()) {}

void InstrumentContact::gather(const StepContext& c, const InstrumentPoses& X, std::span<const NearFace> near,
                               std::span<const PatchNode> first, bool topology_changed,
                               CondensedProblem& problem) {
  const WorldSettings& s = c.settings;
  problem.step = next_number();
  problem.renewal = s.contact;
  problem.topology_changed = topology_changed;
  problem.alarm_distance = s.alarm_distance;
  for (int i = 0; i < max_instruments; ++i) problem.instrument[i] = {X[i], s.coupling[i]};
  know(state.solver, problem);
  problem.instrument_friction = s.instrument_friction;
  problem.pull.fill(Vec3::Zero());
  gatherer_.gather(c.bodies, c.instruments, X, s.alarm_distance, near, problem, first);
  place(c, problem);
}

// The problem at the end of a step is another than the one that was solved: the state is corrected, and
// linearised ahead.
void InstrumentContact::publish_contact(const StepContext& c, const InstrumentSamples& samples, bool presses,
                                        CondensedProblem& problem) {
  ContactState known = state.solver;
  if (presses && problem.renewal == Renewal::renewed) {
    const Within solve(c.times(), StepPart::solve);
    ContactOptions options = contact_options(c.settings);
    options.linearisations = 1;  // other loops begin with it
    options.coulomb.most_rounds = 0;
    if (!usable(solve_contact(problem, c.instruments, poses_of(samples), c.settings.h, options, known,
                              *published_scratch_)))
      known = state.solver;
  }
  know(known, problem);
}

void InstrumentContact::place(const StepContext& c, CondensedProblem& problem) const {
  for (int b = 0; b < c.body_count(); ++b) {
    const Within free_motion(c.times(), StepPart::free_motion);
    if (c.bodies[b].free.forward_solved) know_free_motion(c.bodies[b], gatherer_.nodes_of(b));
  }
  set_patch_positions(c.bodies, gatherer_.nodes(), problem);
}

void InstrumentContact::condense(const StepContext& c, FactorStage& factors, const InstrumentSamples& samples,
                                 CondensedProblem& problem, StepReport& report) {
  const Within condense(c.times(), StepPart::condense);
  const auto nodes = gatherer_.nodes();
  Eigen::Map<MatX> C = problem.C();
  for (int b = 0; b < c.body_count(); ++b) {
    std::vector<int> of_body, index;
    for (std::size_t i = 0; i < nodes.size(); ++i)
      if (nodes[i].body == b) {
        of_body.push_back(nodes[i].node);
        index.push_back(static_cast<int>(i));
      }
    if (of_body.empty()) continue;
    factors.cover(c, b, samples, of_body, report);
    const int n = static_cast<int>(of_body.size());
    for (const int i : index) C.middleCols<3>(3 * i).setZero();  // of other bodies
    if (index.back() - index.front() == n - 1) {
      c.bodies[b].compliance->patch(of_body, C.block(3 * index[0], 3 * index[0], 3 * n, 3 * n));
      continue;
    }
    block_.resize(3 * n, 3 * n);
    c.bodies[b].compliance->patch(of_body, block_);
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i)
        C.block<3, 3>(3 * index[i], 3 * index[j]) = block_.block<3, 3>(3 * i, 3 * j);
  }
}

void InstrumentContact::go_back(const StepContext& c, const InstrumentContactState& before) {
  state = before;
  again_ = true;
  // Its anchors are those that the solve began with.
  if (c.settings.contact == Renewal::renewed && !on_the_way_) state.solver.memory = scratch_->working;
}

void InstrumentContact::solve(const StepContext& c, const InstrumentSamples& samples,
                              const CondensedProblem& problem,
                              const std::optional<EachInstrument<Vec6>>& last, StepReport& report) {
  const Within solve(c.times(), StepPart::solve);
  const WorldSettings& settings = c.settings;
  const InstrumentPoses X = poses_of(samples);
  const bool again = std::exchange(again_, false);
  if (X.any()) {
    // What moves by more than `far_step` in a step may be past the surface before rows reach it. So it is met
    // on the way, with all that the solves there remember.
    InstrumentPoses from = X;
    for (int i = 0; i < max_instruments; ++i)
      if (X.present[i]) from[i] = displaced(c.motion[i].pose(), -c.motion[i].way());
    const EachInstrument<Vec6> way = difference(X, from);
    const double far = settings.contact == Renewal::renewed
                           ? longest_in_reach(problem, c.instruments, X, way) / settings.alarm_distance
                           : 0;
    const double parts = far > far_step ? std::min(far / contact_margin, most_parts) : 0;
    ContactOptions options = contact_options(settings);
    options.parts = parts + 1;
    on_the_way_ = parts >= 1;
    // With the pull of where this one ends, contact is solved again (World::finish_step).
    if (again)
      options.turned = turned;
    else if (!c.contacts.any() && is_pulled(problem))
      options.linearisations = 2;
    for (int p = 1; p <= parts; ++p)
      solve_contact(problem, c.instruments, displaced(from, way, p / (parts + 1)), settings.h, options,
                    state.solver, *scratch_);
    options.parts /= parts + 1 - std::floor(parts);  // what is left of the way
    report.contact = solve_contact(problem, c.instruments, X, settings.h, options, state.solver, *scratch_);
    if (last)
      for (int i = 0; i < max_instruments; ++i)
        report.handover_jump = std::max(report.handover_jump,
                                        (report.contact.wrench[i].head<3>() - (*last)[i].head<3>()).norm());
  } else {
    state.solver = ContactState{};
    scratch_->rows.contacts = 0;
  }
  state.patch_force = pull_on_patch(problem);
  if (usable(report.contact)) state.patch_force += force_on_patch(problem, *scratch_);
}

}  // namespace hapticd
