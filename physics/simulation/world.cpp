#include "physics/simulation/world.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "physics/tissue/fragments.h"

namespace hapticd {
namespace {

constexpr double least_elapsed = 0.1;  // of h, between two samples whose times are known
constexpr double far_step = 0.6;       // in alarm distances
constexpr double most_parts = 32;      // of a step's way that contact is solved on
constexpr int most_bounded = 2;        // steps in a row that a stale compliance may have made energy in

bool is_near(std::span<const NearFace> near, int body) {
  return std::any_of(near.begin(), near.end(), [&](const NearFace& f) { return f.body == body; });
}

}  // namespace

World::World(std::vector<BodySettings> bodies, Instrument instrument, const WorldSettings& settings)
    : settings_(settings),
      instrument_(std::make_unique<Instrument>(std::move(instrument))),
      collision_(*instrument_, settings.alarm_distance),
      gatherer_(settings.sample_spacing),
      scratch_(std::make_unique<ContactScratch>()),
      contacts_(settings.body_contact, settings.h) {
  for (const ContactPair& p : contacts_.pairs())
    if (std::min(p.points, p.faces) < 0 || std::max(p.points, p.faces) >= static_cast<int>(bodies.size()) ||
        p.points == p.faces)
      throw std::invalid_argument("a contact pair names two of the bodies");
  makes_references_ =
      settings.compliance == ComplianceMethod::zone || settings.compliance == ComplianceMethod::lazy;
  last_problem_ = std::make_unique<CondensedProblem>();
  last_scratch_ = std::make_unique<ContactScratch>();
  if (looks_ahead()) ahead_scratch_ = std::make_unique<ContactScratch>();
  ahead_.assign(bodies.size(), 0);
  gone_.resize(bodies.size());
  for (BodySettings& b : bodies)
    bodies_.emplace_back(std::move(b), settings.h, settings.gravity, settings.compliance,
                         settings.compliance_options);
  for (Body& b : bodies_) collision_.add_body(b.surface.faces(), b.state.x);
}

StepReport World::step(const std::function<InstrumentSample()>& latest, CondensedProblem& first,
                       const std::function<CondensedProblem&()>& publish_interim) {
  StepReport report;
  ++steps_;
  topology_changed_ = false;

  InstrumentSample sample = latest();
  follow_instrument(sample);
  remove_scheduled(report);
  remove_at_tip(sample, report);
  removing_ = report.removed > 0;
  changes_.clear();
  for (std::size_t b = 0; b < bodies_.size(); ++b)
    if (bodies_[b].deformable && !bodies_[b].asleep && gone_[b].empty()) {
      const Within collision(times(), StepPart::collision);
      collision_.refit(static_cast<int>(b), bodies_[b].state.x);
    }
  wake(sample);
  report.interim = publish_interim && topology_changed_ && fill_interim(sample, first, report);
  CondensedProblem& problem = report.interim ? publish_interim() : first;
  if (report.interim) topology_changed_ = false;  // since the problem before
  adopt_references(report);
  tell_compliances();
  if (!contacts_.empty()) find_body_contacts();
  factor_and_free_motion(sample, report);

  if (settings_.newest_pose) sample = latest();
  gather(sample, problem, report);
  compliance_of_patch(sample, problem, report);
  if (contacts_.empty())
    solve_instrument(sample, problem, report);
  else
    solve_together(sample, problem, report);
  correct_bodies(report);

  for (std::size_t b = 0; b < bodies_.size(); ++b)
    if (Body& body = bodies_[b]; body.deformable && !body.asleep) {
      if (!settings_.fresh_free_motion) {
        update_rotations(body.model, body.state);
        continue;
      }
      if (foresees(body)) {
        foresee_free_motion(body, settings_.h);  // what comes of it is looked into there
      } else {
        fresh_free_motion(body, settings_.h);
        if (!free_motion_plausible(body)) {
          make_reference(static_cast<int>(b), report);
          compute_free_motion(body, settings_.h);
        }
      }
      if (!contacts_.empty()) finish_free_motion(body, nullptr);
    }
  if (settings_.fresh_free_motion) place_patch(problem);
  if (contacts_.any()) condense_bodies(problem, report);
  if (looks_ahead()) predict_linearisation(sample, problem, report);
  *last_problem_ = problem;
  report_compliance(report);
  put_to_sleep();
  removed_ += report.removed;
  return report;
}

void World::remove_at_tip(const InstrumentSample& sample, StepReport& report) {
  const Within collision(times(), StepPart::collision);
  const Pose X = displaced(sample.pose, removal_lead * twist_);
  const bool cutting = sample.present && sample.phaco;
  // What a tip in the open does not spend does not pile up: one element and one step's worth at most.
  const double per_step = settings_.removal.rate * settings_.h;
  removal_budget_ = cutting ? std::min(removal_budget_ + per_step, 1 + per_step) : 0;
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    Body& body = bodies_[b];
    if (!body.removable) continue;
    int gone = 0;
    if (removal_budget_ >= 1) {
      std::vector<int> tets = tets_at_tip(body.model, body.state, *instrument_, X, settings_.removal.stroke);
      tets.resize(std::min(tets.size(), static_cast<std::size_t>(removal_budget_)));
      removal_budget_ -= static_cast<double>(tets.size());
      gone += take_from(static_cast<int>(b), tets);
      gone += take_from(static_cast<int>(b), hinged_fragments(body.model, body.state, tets, crumb_tets));
    }
    if (sample.present && sample.aspiration && settings_.removal.aspiration_max_tets > 0 &&
        body.state.removed > 0) {
      const Aspirated sucked = fragments_at_tip(body.model, body.state, *instrument_, X, settings_.removal);
      if (sucked.fragments > 0) {
        gone += take_from(static_cast<int>(b), sucked.tets);
        report.fragments_aspirated += sucked.fragments;
      }
    }
    removed_from(static_cast<int>(b), gone, report);
  }
}

void World::remove_scheduled(StepReport& report) {
  const Within collision(times(), StepPart::collision);
  for (const ScheduledRemoval& removal : scheduled_)
    removed_from(removal.body, take_from(removal.body, removal.tets), report);
  scheduled_.clear();
}

int World::take_from(int b, std::span<const int> tets) {
  const std::vector<int> went = take_out(bodies_[b], tets);
  gone_[b].insert(gone_[b].end(), went.begin(), went.end());
  return static_cast<int>(went.size());
}

void World::tell_compliances() {
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    if (gone_[b].empty()) continue;
    bodies_[b].compliance->remove(bodies_[b].state, gone_[b]);
    gone_[b].clear();
    ahead_[b] = 0;
  }
}

void World::removed_from(int b, int gone, StepReport& report) {
  if (gone == 0) return;
  const Body& body = bodies_[b];
  report.removed += gone;
  topology_changed_ = true;
  collision_.set_surface(b, body.surface.faces(), body.state.x);
  contacts_.surface_changed(b);
  // What lay on it may have nothing to lie on now.
  for (const ContactPair& p : contacts_.pairs())
    if (p.points == b || p.faces == b) bodies_[p.points].asleep = bodies_[p.faces].asleep = false;
}

void World::follow_instrument(const InstrumentSample& sample) {
  const bool known = sample.present && was_present_;
  // Steps of a simulation that others starve are farther apart than h, and simulated time then stands still.
  const bool timed = sample.time > 0 && last_time_ > 0;
  const double elapsed =
      timed ? std::max(sample.time - last_time_, least_elapsed * settings_.h) : settings_.h;
  way_ = known ? difference(sample.pose, last_pose_) : Vec6::Zero();
  twist_ = way_ / elapsed;
  if (!known) pose_predictor_.forget();
  if (sample.present) pose_predictor_.follow(sample.pose.p);
  last_pose_ = sample.pose;
  last_time_ = sample.time;
  was_present_ = sample.present;
}

void World::wake(const InstrumentSample& sample) {
  const Within collision(times(), StepPart::collision);
  near_.clear();
  if (!sample.present) return;
  collision_.near_faces(sample.pose, near_);
  for (const NearFace& f : near_) bodies_[f.body].asleep = false;
}

void World::factor(int b, StepReport& report) {
  Body& body = bodies_[b];
  if (looks_ahead()) {
    const Within assembly(times(), StepPart::assembly);
    update_rotations(body.model, body.state);  // they are of where it was thought to be
  }
  body.compliance->update(body.state);
  compute_free_motion(body, settings_.h);
  if (!free_motion_plausible(body) || (makes_references_ && body.energy.bounded_steps >= most_bounded)) {
    make_reference(b, report);
    compute_free_motion(body, settings_.h);
  }
  if (!contacts_.empty()) finish_free_motion(body, nullptr);  // of any node that may meet another body
}

void World::factor_and_free_motion(const InstrumentSample& sample, StepReport& report) {
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    Body& body = bodies_[b];
    if (!body.deformable || body.asleep) continue;
    if (sample.present || !contacts_.nodes_of(static_cast<int>(b)).empty())
      update_zone(static_cast<int>(b), sample, {});
    ++report.awake_bodies;
    if (!ahead_[b]) factor(static_cast<int>(b), report);
  }
}

void World::gather(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report) {
  const Within collision(times(), StepPart::collision);
  problem.step = ++problems_;
  problem.X_ref = sample.pose;
  problem.renewal = settings_.contact;
  problem.topology_changed = topology_changed_;
  problem.alarm_distance = settings_.alarm_distance;
  problem.coupling = settings_.coupling;
  // Where the instrument has not moved since the start of the step, they are known.
  const bool there =
      was_present_ && sample.pose.p == last_pose_.p && sample.pose.q.coeffs() == last_pose_.q.coeffs();
  if (!sample.present)
    near_.clear();
  else if (!there)
    collision_.near_faces(sample.pose, near_);
  // The instrument may have come within reach of a sleeping body since the start of the step.
  for (const NearFace& f : near_) {
    Body& body = bodies_[f.body];
    if (!body.deformable || !body.asleep) continue;
    body.asleep = false;
    update_zone(f.body, sample, {});
    factor(f.body, report);
  }
  gatherer_.gather(bodies_, *instrument_, sample.pose, settings_.alarm_distance, near_, problem);
  place_patch(problem);
}

std::vector<int> World::patch_nodes_of(int b) const {
  std::vector<int> nodes;
  for (const PatchNode& n : gatherer_.nodes())
    if (n.body == b) nodes.push_back(n.node);
  return nodes;
}

void World::place_patch(CondensedProblem& problem) {
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    const Within free_motion(times(), StepPart::free_motion);
    if (bodies_[b].free.forward_solved) know_free_motion(bodies_[b], patch_nodes_of(static_cast<int>(b)));
  }
  set_patch_positions(bodies_, gatherer_.nodes(), problem);
}

void World::compliance_of_patch(const InstrumentSample& sample, CondensedProblem& problem,
                                StepReport& report) {
  const Within condense(times(), StepPart::condense);
  const auto nodes = gatherer_.nodes();
  problem.C().setZero();
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    std::vector<int> of_body, index;
    for (std::size_t i = 0; i < nodes.size(); ++i)
      if (nodes[i].body == static_cast<int>(b)) {
        of_body.push_back(nodes[i].node);
        index.push_back(static_cast<int>(i));
      }
    if (of_body.empty()) continue;
    Body& body = bodies_[b];
    cover(static_cast<int>(b), sample, of_body, report);
    const int n = static_cast<int>(of_body.size());
    block_.resize(3 * n, 3 * n);
    body.compliance->patch(of_body, block_);
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i)
        problem.C().block<3, 3>(3 * index[i], 3 * index[j]) = block_.block<3, 3>(3 * i, 3 * j);
  }
}

void World::report_compliance(StepReport& report) {
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    Body& body = bodies_[b];
    if (!body.deformable || body.asleep) continue;
    report.compliance.push_back({static_cast<int>(b), body.compliance->report()});
    if (report.compliance.back().compliance.wants_reference) body.reference.wanted = true;
    ++body.reference.steps;
  }
}

ContactOptions World::contact_options() const {
  ContactOptions options;
  options.linearisations = settings_.linearisations;
  options.coulomb = settings_.coulomb;
  options.margin = settings_.contact == Renewal::frozen ? 0 : contact_margin * settings_.alarm_distance;
  return options;
}

ContactSolution World::solve_last_problem(const InstrumentSample& sample) {
  ContactState state = contact_state_;
  state.frozen_step = 0;  // the rows of that step are in the other scratch
  return solve_contact(*last_problem_, *instrument_, sample.pose, settings_.h, contact_options(), state,
                       *last_scratch_);
}

void World::solve_instrument(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report) {
  const Within solve(times(), StepPart::solve);
  if (sample.present) {
    const bool compares =
        makes_references_ && last_problem_->step > 0 && (report.references_adopted > 0 || report.removed > 0);
    const Vec3 before = compares ? Vec3(solve_last_problem(sample).wrench.head<3>()) : Vec3::Zero();
    // What moves by more than `far_step` in a step may be past the surface before rows reach it. So it is met
    // on the way, with all that the solves there remember.
    const Pose from = displaced(last_pose_, -way_);
    const Vec6 way = difference(sample.pose, from);
    const double far =
        settings_.contact == Renewal::renewed ? way.head<3>().norm() / settings_.alarm_distance : 0;
    const double parts = far > far_step ? std::min(far / contact_margin, most_parts) : 0;
    for (int p = 1; p <= parts; ++p)
      solve_contact(problem, *instrument_, displaced(from, p / (parts + 1) * way), settings_.h,
                    contact_options(), contact_state_, *scratch_);
    report.contact = solve_contact(problem, *instrument_, sample.pose, settings_.h, contact_options(),
                                   contact_state_, *scratch_);
    if (compares) report.handover_jump = (report.contact.wrench.head<3>() - before).norm();
  } else {
    contact_state_ = ContactState{};
    scratch_->rows.contacts = 0;
  }

  patch_force_ = usable(report.contact) ? force_on_patch(problem, *scratch_) : VecX::Zero(3 * problem.nodes);
}

// Σ Hᵀλ of a solve, by node [N].
VecX World::force_on_patch(const CondensedProblem& problem, const ContactScratch& scratch) const {
  const ContactRows& rows = scratch.rows;
  VecX f = VecX::Zero(3 * problem.nodes);
  for (int i = 0; i < rows.contacts; ++i) {
    const PatchSample& s = problem.sample[rows.row[i].sample];
    if (s.node[0] < 0) continue;
    Vec3 force = scratch.lambda[rows.rows_per_contact * i] * rows.row[i].frame.col(0);
    for (int t = 1; t < rows.rows_per_contact; ++t)
      force += scratch.lambda[rows.rows_per_contact * i + t] * rows.row[i].frame.col(t);
    for (int c = 0; c < 3; ++c) f.segment<3>(3 * s.node[c]) += s.weight[c] * force;
  }
  return f;
}

void World::correct_bodies(StepReport& report) {
  const auto nodes = gatherer_.nodes();
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    Body& body = bodies_[b];
    if (!body.deformable || body.asleep) continue;
    ahead_[b] = 0;
    contact_force_.setZero(3 * body.model.node_count());
    for (std::size_t i = 0; i < nodes.size(); ++i)
      if (nodes[i].body == static_cast<int>(b))
        contact_force_.segment<3>(3 * nodes[i].node) +=
            patch_force_.segment<3>(3 * static_cast<Eigen::Index>(i));
    if (contacts_.any()) contacts_.add_forces(static_cast<int>(b), contact_force_);
    correct(body, contact_force_.isZero(0) ? nullptr : &contact_force_, settings_.h, settings_.keeps_energy);
    report.bounded_bodies += body.energy.bounded_steps > 0;
  }
}

void World::put_to_sleep() {
  std::vector<std::uint8_t> still(bodies_.size(), 1);
  for (std::size_t b = 0; b < bodies_.size(); ++b)
    if (bodies_[b].deformable) still[b] = at_rest(bodies_[b]) && !is_near(near_, static_cast<int>(b));
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    if (!bodies_[b].deformable) continue;
    bodies_[b].asleep = still[b];
    for (std::size_t c = 0; still[b] && contacts_.any() && c < bodies_.size(); ++c)
      if (!still[c] && contacts_.touching(static_cast<int>(b), static_cast<int>(c)))
        bodies_[b].asleep = false;
  }
}

}  // namespace hapticd
