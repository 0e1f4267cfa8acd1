// The part of the step in which bodies touch bodies, solved together with the instrument.
//
//   [rows of the instrument and of the bodies at the last solve's state → one solve of all of them] …
//
// until neither force nor geometry changes: two or three rounds. Taking turns instead (bodies given the
// force, the instrument on their condensed response) does not converge: what the instrument starts to slide
// is stuck in one turn and thrown in the next. Coupling, slip and anchors are those of contact_solve.h.
#include <algorithm>

#include "physics/simulation/world.h"

namespace hapticd {
namespace {

constexpr int most_rounds = 16;
constexpr int most_attempts = 5;        // at finding the nodes that a fast step brings into touch
constexpr double settled_force = 1e-6;  // relative
constexpr double settled_gap = 1e-7;    // [m]

double relaxed(int round) { return round < 4 ? 1 : round < 8 ? 0.5 : 0.25; }

// The instrument's part of the common solve: its rows, its place on the virtual coupling, its memory.
class InstrumentSide {
 public:
  InstrumentSide(const CondensedProblem& problem, const Instrument& instrument, const Pose& device,
                 const WorldSettings& settings, ContactState& state, ContactScratch& scratch)
      : problem_(problem), instrument_(instrument), device_(device), state_(state), scratch_(scratch) {
    K_inv_ = inverse_stiffness(problem.coupling, settings.h);
    // The part of the last offset that the coupling's damper still holds.
    const double lag = problem.coupling.damping_time / (settings.h + problem.coupling.damping_time);
    Vec6 held = lag * state.coupling_offset, offset = state.coupling_offset;
    for (int c = 0; c < 6; ++c)
      if (K_inv_[c] == 0) held[c] = offset[c] = 0;
    X_free_ = displaced(device, -held);
    frozen_ = problem.renewal == Renewal::frozen;
    X_ = frozen_ ? problem.X_ref : displaced(device, -offset);
    margin_ = frozen_ ? problem.alarm_distance : contact_margin * problem.alarm_distance;
    working_ = state.memory;
  }

  VecX lambda;

  void linearise(const BodyContacts& contacts) {
    // Where a force is forgotten, the last solve's geometry: rows.h.
    if (frozen_ || (first_ && forgets(problem_, state_.memory)))
      scratch_.x = problem_.x_now;
    else
      contacts.patch_positions(scratch_.x);
    first_ = false;
    ContactRows& rows = scratch_.rows;
    build_rows(problem_, instrument_, X_free_, X_, scratch_.x, K_inv_, working_, margin_, rows);
    ++scratch_.matrix_version;
    lambda = VecX::Zero(rows.rows());
    for (int i = 0; i < rows.contacts; ++i)
      if (const ContactMemory::Entry* known = working_.find(rows.row[i].id))
        lambda.segment(rows.rows_per_contact * i, rows.rows_per_contact) =
            (rows.row[i].frame.transpose() * known->lambda).head(rows.rows_per_contact);
  }

  // After a solve: the instrument where its forces put it, and the forces to start from again.
  void follow(double part) {
    remember(working_);
    const Pose end = place();
    if (!frozen_) X_ = displaced(X_, part * difference(end, X_));
  }

  ContactSolution finish(const BodyContacts& contacts) {
    const ContactRows& rows = scratch_.rows;
    contacts.patch_positions(scratch_.x);
    std::copy_n(lambda.data(), lambda.size(), scratch_.lambda.data());
    ContactSolution out;
    out.status = contacts.report().status;
    out.residual = contacts.report().residual;
    out.contacts = rows.contacts;
    out.dropped = rows.dropped;
    out.wrench = wrench();
    out.instrument = place();
    if (!out.wrench.allFinite()) {
      state_ = ContactState{};
      out.status = SolveStatus::not_finite;
      out.wrench.setZero();
      out.instrument = X_free_;
      return out;
    }
    const Vec6 moved = difference(out.instrument, problem_.X_ref);
    remember(state_.memory);
    for (int i = 0; i < rows.contacts; ++i) {
      const ContactRow& row = rows.row[i];
      const Vec3 s = sample_position(problem_, scratch_.x, row.sample);
      out.active += lambda[rows.rows_per_contact * i] > 0;
      out.penetration = std::max(out.penetration, -gap_at(instrument_, out.instrument, s).distance);
      ContactMemory::Entry& e = state_.memory.entry[i];
      e.sticking = sticks(contacts, i);
      if (!e.sticking)
        e.anchor = frozen_ ? problem_.X_ref.to_local(s - moved.head<3>() - moved.tail<3>().cross(row.arm))
                           : out.instrument.to_local(s);
    }
    state_.coupling_offset = difference(device_, out.instrument);
    for (int c = 0; c < 6; ++c)
      if (K_inv_[c] == 0) state_.coupling_offset[c] = 0;
    return out;
  }

 private:
  Vec6 wrench() const {
    return wrench_on_instrument(scratch_.rows, {lambda.data(), static_cast<std::size_t>(lambda.size())});
  }
  Pose place() const { return displaced(X_free_, K_inv_.cwiseProduct(wrench())); }

  void remember(ContactMemory& memory) const {
    const ContactRows& rows = scratch_.rows;
    memory.count = rows.contacts;
    for (int i = 0; i < rows.contacts; ++i) {
      const int m = rows.rows_per_contact;
      const Vec3 force = rows.row[i].frame.leftCols(m) * lambda.segment(m * i, m);
      memory.entry[i] = {rows.row[i].id, force, rows.row[i].anchor, false};
    }
  }

  bool sticks(const BodyContacts& contacts, int i) const {
    const ContactRows& rows = scratch_.rows;
    const double mu = rows.row[i].friction;
    if (rows.rows_per_contact == 1 || mu <= 0 || lambda[3 * i] <= 0) return false;
    const Vec3 l = lambda.segment<3>(3 * i);
    if (l.tail<2>().norm() <= inside_the_cone * mu * l[0]) return true;
    return contacts.tool_delta().segment<2>(3 * i + 1).norm() <=
           sticking_slip * rows.W().block<3, 3>(3 * i, 3 * i).trace() / 3 * l.norm();
  }

  const CondensedProblem& problem_;
  const Instrument& instrument_;
  Pose device_, X_free_, X_;
  ContactState& state_;
  ContactScratch& scratch_;
  Vec6 K_inv_;
  ContactMemory working_;
  double margin_;
  bool frozen_;
  bool first_ = true;
};

}  // namespace

void World::find_body_contacts() {
  contacts_.find(bodies_);
  for (const ContactPair& p : contacts_.pairs()) {
    Body &a = bodies_[p.points], &b = bodies_[p.faces];
    if (!contacts_.touching(p.points, p.faces)) continue;
    if (a.deformable && a.asleep && b.deformable && !b.asleep && !at_rest(b)) a.asleep = false;
    if (b.deformable && b.asleep && a.deformable && !a.asleep && !at_rest(a)) b.asleep = false;
  }
}

// The last solve's forces on the patch, found again by sample.
VecX World::remembered_force(const CondensedProblem& problem) const {
  VecX f = VecX::Zero(3 * problem.nodes);
  for (int k = 0; k < problem.samples; ++k) {
    const PatchSample& s = problem.sample[k];
    if (s.node[0] < 0) continue;
    const ContactMemory::Entry* known = contact_state_.memory.find(s.id);
    for (int c = 0; known && c < 3; ++c) f.segment<3>(3 * s.node[c]) += s.weight[c] * known->lambda;
  }
  return f;
}

void World::begin_solve(const InstrumentSample& sample, StepReport& report) {
  contacts_.set_domains(bodies_, gatherer_.nodes());
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    const auto nodes = contacts_.domain_nodes(static_cast<int>(b));
    if (nodes.empty()) continue;
    cover(static_cast<int>(b), sample, nodes, report);
    MatX& C = contacts_.compliance(static_cast<int>(b));
    C.resize(3 * static_cast<Eigen::Index>(nodes.size()), 3 * static_cast<Eigen::Index>(nodes.size()));
    bodies_[b].compliance->patch(nodes, C);
  }
  contacts_.set_free_motion(bodies_);
}

void World::solve_both(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report) {
  begin_solve(sample, report);
  VecX force = remembered_force(problem);
  contacts_.solve(force);
  double off = contacts_.linearise(bodies_);
  int round = 1;
  const bool reached = sample.present && problem.samples > 0;
  if (!reached) {
    solve_instrument(sample, problem, report);
    for (; round < most_rounds && off > settled_gap; ++round) {
      contacts_.relax(relaxed(round));
      contacts_.solve(force);
      off = contacts_.linearise(bodies_);
    }
  } else {
    InstrumentSide tool(problem, *instrument_, sample.pose, settings_, contact_state_, *scratch_);
    for (double change = 1; round < most_rounds && (change > settled_force || off > settled_gap); ++round) {
      contacts_.relax(relaxed(round));
      const VecX last = force;
      tool.linearise(contacts_);
      force = contacts_.solve_with(problem, scratch_->rows, tool.lambda);
      tool.follow(relaxed(round));
      off = contacts_.linearise(bodies_);
      const double size = std::max(force.norm(), last.norm());
      change = size > 0 ? (force - last).norm() / size : 0;
    }
    report.contact = tool.finish(contacts_);
  }
  patch_force_ = force;
  contacts_.report().rounds = round;
}

void World::predict_end(int b) {
  const Body& body = bodies_[b];
  if (!body.deformable || body.asleep) return;
  x_end_[b] = body.state.x;
  contact_force_.setZero(3 * body.model.node_count());
  const auto nodes = gatherer_.nodes();
  for (std::size_t i = 0; i < nodes.size(); ++i)
    if (nodes[i].body == b)
      contact_force_.segment<3>(3 * nodes[i].node) +=
          patch_force_.segment<3>(3 * static_cast<Eigen::Index>(i));
  if (contacts_.any()) contacts_.add_forces(b, contact_force_);
  if (!contact_force_.isZero(0)) body.compliance->apply(contact_force_, contact_force_);
  for (std::size_t n = 0; n < x_end_[b].size(); ++n)
    x_end_[b][n] += body.free.dx.segment<3>(3 * static_cast<Eigen::Index>(n)) +
                    contact_force_.segment<3>(3 * static_cast<Eigen::Index>(n));
}

// A step that takes a body into one that sleeps wakes it at once, or it would be hit like a wall.
void World::wake_touched(const InstrumentSample& sample) {
  for (const ContactPair& p : contacts_.pairs())
    for (const int b : {p.points, p.faces}) {
      Body& body = bodies_[b];
      if (!body.deformable || !body.asleep || !contacts_.touching(p.points, p.faces)) continue;
      body.asleep = false;
      update_zone(b, sample, {});
      body.compliance->update(body.state);
      compute_free_motion(body, settings_.h);
      finish_free_motion(body, nullptr);
    }
}

void World::solve_together(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report) {
  const ContactState before = contact_state_;
  x_end_.resize(bodies_.size());
  for (int attempt = 0; attempt < most_attempts; ++attempt) {
    contact_state_ = before;
    if (contacts_.any())
      solve_both(sample, problem, report);
    else
      solve_instrument(sample, problem, report);
    for (const ContactPair& p : contacts_.pairs())
      for (const int b : {p.points, p.faces}) predict_end(b);
    const Positions end = [&](int b) {
      return std::span<const Vec3>(bodies_[b].deformable && !bodies_[b].asleep ? x_end_[b]
                                                                               : bodies_[b].state.x);
    };
    if (attempt + 1 == most_attempts || contacts_.join_missed(bodies_, end) == 0) break;
    wake_touched(sample);
  }
  // Where all sleep, the forces of the last step hold them.
  if (report.awake_bodies > 0) contacts_.keep();
  report.body_contact = contacts_.report();
}

ContactSolution World::solve_unfrozen(const InstrumentSample& sample, const CondensedProblem& published) {
  const auto problem = std::make_unique<CondensedProblem>(published);
  const ContactState before = contact_state_;
  const VecX force = patch_force_;
  StepReport report;
  set_patch_positions(bodies_, gatherer_.nodes(), *problem);
  compliance_of_patch(sample, *problem, report);
  if (contacts_.any())
    solve_both(sample, *problem, report);
  else
    solve_instrument(sample, *problem, report);
  contact_state_ = before;
  patch_force_ = force;
  return report.contact;
}

// For what is published: contacts at the state just reached and under its fresh free motion.
void World::condense_bodies(CondensedProblem& problem, StepReport& report) {
  report.body_contact = contacts_.report();
  contacts_.set_free_motion(bodies_);
  // How deep the step left anything, before the next one is looked at.
  report.body_contact.penetration = contacts_.report().penetration;
  contacts_.solve(patch_force_);
  if (problem.nodes == 0) return;
  contacts_.linearise(bodies_);
  contacts_.solve(patch_force_);
  contacts_.condense(problem);
}

}  // namespace hapticd
