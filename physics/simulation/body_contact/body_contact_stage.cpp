#include "physics/simulation/body_contact/body_contact_stage.h"

#include <algorithm>
#include <limits>

#include "physics/simulation/body_contact/anderson_mixing.h"
#include "physics/simulation/body_contact/instrument_side.h"

namespace hapticd {
namespace {

constexpr int most_rounds = 16;         // with geometry renewed
constexpr int rounds_of_draft = 2;      // as the instruments alone have in a scene without contacts
constexpr int patience = 3;             // rounds in vain, after which geometry is held
constexpr double in_vain = 0.7;         // of what was left before
constexpr int most_sliding = 40;        // solves with geometry held and friction free to change
constexpr int most_held = 200;          // … and with friction held: the proof counts none
constexpr int most_attempts = 40;       // at finding the nodes that a fast step brings into touch
constexpr double settled_force = 1e-4;  // relative: friction is solved to 1e-5 of it
constexpr double settled_gap = 1e-7;    // [m]
constexpr double held_gap = 1e-6;       // overlap that geometry held may leave [m]

// Rounds of a solve, and whether they come to an end.
class Rounds {
 public:
  explicit Rounds(int most) : most_(most) {}

  // left: what has not settled, in its tolerance.
  void end(double left) {
    ++count_;
    left_ = left;
    since_ = left < in_vain * best_ ? 0 : since_ + 1;
    best_ = std::min(best_, left);
  }
  bool settled() const { return left_ <= 1; }
  bool go_on() const { return !settled() && count_ < most_ && since_ < patience; }
  int count() const { return count_; }

 private:
  int most_, count_ = 0, since_ = 0;
  double left_ = 2, best_ = std::numeric_limits<double>::infinity();
};

// Loose pieces that suction holds begin where their instrument takes them (contact_solve.cpp says why).
void carry(const StepContext& c, const CondensedProblem& problem, BodyContacts& contacts) {
  const auto nodes = c.patch.nodes();
  for (int b = 0; b < c.body_count(); ++b) {
    const Body& body = c.bodies[b];
    bool pulled = false;
    for (std::size_t k = 0; k < nodes.size(); ++k)
      pulled = pulled || (nodes[k].body == b && !problem.pull[k].isZero(0));
    if (!pulled) continue;
    bool held = false;
    for (int n = 0; n < body.model.nodes_in_use; ++n) held = held || body.model.holds(n);
    if (held) continue;
    for (const InstrumentReference& of : problem.instrument.value) {
      if (of.load.isZero(0)) continue;
      const Vec3 origin = of.X_ref.p - of.way.head<3>();
      std::vector<Vec3> x = body.state.x;
      for (Vec3& at : x) at += of.way.head<3>() + of.way.tail<3>().cross(at - origin);
      contacts.start_from(b, x);
      break;
    }
  }
  contacts.linearise(c.bodies);
}

}  // namespace

BodyContactStage::BodyContactStage(const WorldSettings& settings)
    : contacts_(settings.body_contact, settings.h) {}
BodyContactStage::~BodyContactStage() = default;

void BodyContactStage::surface_changed(Bodies& bodies, int b) {
  contacts_.surface_changed(b);
  if (!contacts_.names(b)) return;
  const bool slept = bodies[b].asleep;  // and those that slept with it were not looked for
  for (const ContactPair& p : contacts_.pairs()) {
    const bool near = contacts_.touching(p.points, p.faces) || slept;
    if ((p.points == b || p.faces == b) && near) bodies[p.points].asleep = bodies[p.faces].asleep = false;
  }
  bodies[b].asleep = false;
}

void BodyContactStage::find(Bodies& bodies) {
  if (contacts_.empty()) return;
  known_.assign(bodies.size(), {});
  x_end_.clear();
  contacts_.find(bodies);
  for (const ContactPair& p : contacts_.pairs()) {
    Body &a = bodies[p.points], &b = bodies[p.faces];
    if (!contacts_.touching(p.points, p.faces)) continue;
    if (a.deformable && a.asleep && b.deformable && !b.asleep && !at_rest(b)) a.asleep = false;
    if (b.deformable && b.asleep && a.deformable && !a.asleep && !at_rest(a)) b.asleep = false;
  }
}

void BodyContactStage::begin_solve(const StepContext& c, FactorStage& factors,
                                   const InstrumentSamples& samples, const CondensedProblem& problem,
                                   StepReport& report) {
  contacts_.set_domains(c.bodies, c.patch.nodes());
  for (int b = 0; b < c.body_count(); ++b) {
    const auto nodes = contacts_.domain_nodes(b);
    if (nodes.empty() || std::ranges::equal(nodes, known_[b])) continue;
    known_[b].assign(nodes.begin(), nodes.end());
    factors.cover(c, b, samples, nodes, report);
    MatX& C = contacts_.compliance(b);
    C.resize(3 * static_cast<Eigen::Index>(nodes.size()), 3 * static_cast<Eigen::Index>(nodes.size()));
    c.bodies[b].compliance->patch(nodes, C);
  }
  contacts_.set_free_motion(c.bodies);
  contacts_.pull(pull_on_patch(problem));
  if (!known_end_) return;
  for (int b = 0; b < c.body_count(); ++b)
    if (!contacts_.domain_nodes(b).empty() && !x_end_[b].empty()) contacts_.start_from(b, x_end_[b]);
  contacts_.linearise(c.bodies);
}

// What converges: J(x) = ½ ‖x − x_free‖²_A is least over the half spaces of the rows there are. Rows are only
// added, so J rises and, by its strong convexity, ½ ‖x_k+1 − x_k‖²_A ≤ J_k+1 − J_k. J is bounded where the
// half spaces have a point in common, so the steps go to nothing, and with them the overlap: a row that was
// added at x_k holds at x_k+1. With friction J has no such bound; where that goes round in circles, or one of
// its solves does not end, friction stays what the last solve found, a given force, and the proof holds
// again.
void BodyContactStage::hold_geometry(const StepContext& c, const std::function<void()>& solve) {
  BodyContactReport& report = contacts_.report();
  report.held = true;
  double deepest = contacts_.add_violated(c.bodies, held_gap);
  const auto unsolved = [&] { return report.status != SolveStatus::solved; };
  for (int k = 0; k < most_sliding + most_held && (deepest > 0 || unsolved()); ++k) {
    report.friction_held = report.friction_held || k >= most_sliding || unsolved();
    contacts_.hold_friction(report.friction_held);
    solve();
    ++report.rounds;
    deepest = contacts_.add_violated(c.bodies, held_gap);
  }
  contacts_.hold_friction(false);
  report.capped = deepest > 0 || unsolved();
}

// Of bodies and instruments [m].
VecX BodyContactStage::linearisation_point() const {
  const VecX x = contacts_.linearisation_point(), X = tool_->linearisation_point();
  VecX both(x.size() + X.size());
  both << x, X;
  return both;
}

void BodyContactStage::linearise_at(const VecX& point) {
  contacts_.go_to(point.head(point.size() - InstrumentSide::point_size));
  tool_->go_to(point.tail(InstrumentSide::point_size));
}

void BodyContactStage::solve_once(const StepContext& c, FactorStage& factors, InstrumentContact& contact,
                                  const InstrumentSamples& samples, const CondensedProblem& problem,
                                  const std::optional<EachInstrument<Vec6>>& last, bool draft,
                                  StepReport& report) {
  if (!contacts_.any()) return contact.solve(c, samples, problem, last, report);
  begin_solve(c, factors, samples, problem, report);
  contacts_.report().held = contacts_.report().friction_held = contacts_.report().capped = false;
  const bool goes_on = known_end_ && tool_;
  if (!goes_on) tool_force_ = remembered_force(problem, contact.state.solver.memory);
  VecX& force = tool_force_;
  Rounds rounds(draft ? rounds_of_draft : most_rounds);
  const auto solved = [&] { return contacts_.report().status == SolveStatus::solved; };
  double first = 0;
  if (!goes_on && is_pulled(problem)) {
    carry(c, problem, contacts_);
  } else if (!goes_on) {
    contacts_.solve(force);
    first = contacts_.linearise(c.bodies);
  }
  if (any_present(samples) && problem.samples > 0) {
    if (!goes_on)
      tool_ = std::make_unique<InstrumentSide>(problem, c.instruments, poses_of(samples), c.settings.h,
                                               contact_margin * problem.alarm_distance, contact.state.solver,
                                               contact.scratch());
    InstrumentSide& tool = *tool_;
    const auto solve = [&] { force = contacts_.solve_with(problem, contact.scratch().rows, tool.lambda); };
    AndersonMixing mixing;
    VecX end;
    do {
      const VecX before = force, begin = linearisation_point();
      tool.linearise(contacts_);
      solve();
      tool.follow();
      end = linearisation_point();
      const VecX next = mixing.next(begin, end);
      linearise_at(next);
      const double off = contacts_.linearise(c.bodies) + (next - end).cwiseAbs().maxCoeff();
      const double size = std::max(force.norm(), before.norm());
      const double change = size > 0 ? (force - before).norm() / size : 0;
      rounds.end(std::max(off / settled_gap, change / settled_force));
    } while (rounds.go_on() && solved());
    if (!rounds.settled()) linearise_at(end);
    contacts_.report().rounds = rounds.count();
    if (!draft && (!rounds.settled() || !solved())) hold_geometry(c, solve);
    report.contact = tool.finish(contacts_);
  } else {
    contact.solve(c, samples, problem, last, report);
    rounds.end(first / settled_gap);
    while (rounds.go_on() && solved()) {
      contacts_.solve(force);
      rounds.end(contacts_.linearise(c.bodies) / settled_gap);
    }
    contacts_.report().rounds = rounds.count();
    if (!draft && (!rounds.settled() || !solved())) hold_geometry(c, [&] { contacts_.solve(force); });
  }
  contact.state.patch_force = force + pull_on_patch(problem);
}

void BodyContactStage::predict_end(const StepContext& c, int b, const VecX& patch_force) {
  const Body& body = c.bodies[b];
  if (!is_awake(body)) return;
  x_end_[b] = body.state.x;
  VecX& moved = responses_[b] = force_on_body(body, b, c.patch.nodes(), patch_force);
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
                             const std::optional<EachInstrument<Vec6>>& last, bool draft,
                             const std::function<bool()>& in_vain, StepReport& report) {
  if (contacts_.empty()) return contact.solve(c, samples, problem, last, report);
  const ContactState before = contact.state.solver;
  // A step's second solve, with suction of another size, goes on from where the first took the bodies.
  known_end_ = !x_end_.empty();
  x_end_.resize(c.bodies.size());
  responses_.assign(c.bodies.size(), {});
  tool_.reset();
  int missing = 0;
  for (int attempt = 0; attempt < most_attempts; ++attempt) {
    contact.state.solver = before;
    solve_once(c, factors, contact, samples, problem, last, draft, report);
    if (draft ? !contacts_.any() : in_vain()) break;
    for (int b = 0; b < c.body_count(); ++b)
      if (contacts_.names(b)) predict_end(c, b, contact.state.patch_force);
    known_end_ = true;
    const Positions end = [&](int b) {
      return std::span<const Vec3>(is_awake(c.bodies[b]) ? x_end_[b] : c.bodies[b].state.x);
    };
    if (draft) break;
    missing = contacts_.join_missed(c.bodies, end);
    if (missing == 0) break;
    wake_touched(c, factors, samples);
  }
  known_end_ = false;
  tool_.reset();
  contacts_.report().capped |= missing > 0;
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
