#include "physics/simulation/world.h"

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "physics/contact/suction.h"
#include "physics/simulation/aspiration/inflow.h"

namespace hapticd {
namespace {

bool is_near(std::span<const NearFace> near, int body) {
  return std::any_of(near.begin(), near.end(), [&](const NearFace& f) { return f.body == body; });
}

bool any_thinned(const Bodies& bodies) {
  return std::any_of(bodies.begin(), bodies.end(), [](const Body& b) { return b.thinned; });
}

// Whether nearly every step removes something. Where it is one in some, an interim problem is felt sooner and
// as a smaller step: of one that takes half of the force, 7.8 in place of 8.3 % of it in a millisecond.
bool removes_often(const WorldSettings& s) {
  return std::any_of(s.removal.value.begin(), s.removal.value.end(),
                     [&](const RemovalSettings& r) { return r.rate * s.h > (r.gradual ? 0 : 1 + 1e-9); });
}

}  // namespace

World::World(std::vector<BodySettings> bodies, std::vector<Instrument> instruments,
             const WorldSettings& settings)
    : settings_(settings),
      instruments_(std::move(instruments)),
      collision_(instruments_, settings.alarm_distance),
      removal_(settings.removal, settings.h, bodies.size()),
      factors_(settings, bodies.size()),
      regions_(bodies.size()),
      contact_(settings.sample_spacing),
      body_contact_(settings),
      prediction_(settings),
      context_{settings_, instruments_, motion_, contact_.patch(), body_contact_.contacts(), bodies_} {
  if (instruments_.empty() || instruments_.size() > max_instruments)
    throw std::invalid_argument("a world has one to " + std::to_string(max_instruments) + " instruments");
  for (const ContactPair& p : contacts().pairs())
    if (std::min(p.points, p.faces) < 0 || std::max(p.points, p.faces) >= static_cast<int>(bodies.size()) ||
        (p.points == p.faces && !bodies[p.points].deformable))
      throw std::invalid_argument("a contact pair names two of the bodies, or one that comes apart twice");
  for (BodySettings& b : bodies)
    bodies_.emplace_back(std::move(b), settings.h, settings.gravity, settings.compliance,
                         settings.compliance_options);
  for (Body& b : bodies_) collision_.add_body(b.surface.faces(), b.state.x);
  cutting_ = CuttingStage(instruments_, bodies_);
}

StepReport World::step(const std::function<InstrumentSamples()>& latest, CondensedProblem& first,
                       const std::function<CondensedProblem&()>& publish_interim) {
  const StepBegin begun = begin_step(latest(), publish_interim ? &first : nullptr);
  CondensedProblem& problem = begun.interim ? publish_interim() : first;
  factor_step();
  const StepReport report = finish_step(settings_.newest_pose ? latest() : begun_with_, problem);
  look_for_cracks();
  return report;
}

StepBegin World::begin_step(const InstrumentSamples& samples, CondensedProblem* interim) {
  StepReport& report = report_ = {};
  ++steps_;
  begun_with_ = samples;
  refresh_.forget();

  motion_.follow(samples, settings_.h);
  remove(samples, report);
  refit();
  // An interim problem knows what went, not what split.
  const bool split = cut(report);
  report.interim = interim && report.removed > 0 && !split && fill_interim(samples, *interim, report);
  return {report.removed, report.interim};
}

void World::factor_step() {
  const std::vector<int> entered = regions_.take_over(bodies_);
  for (const int b : entered) factors_.references.forget(b);
  surfaces_changed(entered);
  report_.regions_entered = static_cast<int>(entered.size());
  report_.references_adopted = factors_.references.take_over(bodies_) + report_.regions_entered;
  removal_.tell_compliances(bodies_);
  cutting_.tell_compliances(bodies_);
  body_contact_.find(bodies_);
  factors_.run(context_, begun_with_, report_);
}

const StepReport& World::finish_step(const InstrumentSamples& newest, CondensedProblem& problem) {
  StepReport& report = report_;
  const InstrumentSamples& samples = settings_.newest_pose ? newest : begun_with_;
  const bool topology_changed =
      (report.removed > 0 || report.split) && !report.interim;  // since the one before
  look_again(samples);
  gather(samples, topology_changed, problem, report);
  contact_.condense(context_, factors_, samples, problem, report);
  report.occlusion = draw(samples, problem);
  const auto before = is_pulled(problem) ? std::optional(contact_.state) : std::nullopt;
  const std::optional<EachInstrument<Vec6>> last = wrenches_before_handover(samples, report);
  const PatchPositions& x = contact_.scratch().x;
  const auto drawn = [&] { return before && usable(report.contact); };
  const auto throws = [&] { return drawn() && drawing_.throws(instruments_, x, problem); };
  for (bool draft = before && !contacts().empty();; draft = false) {
    body_contact_.solve(context_, factors_, contact_, samples, problem, last, draft, throws, report);
    const bool again = drawn() && drawing_.again(instruments_, samples, report.contact.instrument, x, problem,
                                                 report.occlusion);
    if (!again && !draft) break;
    if (again && !contacts().any())
      contact_.go_back(context_, *before);
    else
      contact_.state = *before;
  }
  report.condensed_nodes = pressed_condensed_nodes();
  placed_ = usable(report.contact) ? report.contact.instrument : InstrumentPoses();
  report.bounded_bodies = correct_bodies(context_, contact_.state.patch_force, body_contact_.responses());
  if (usable(report.contact))
    cutting_.advance(bodies_, instruments_, poses_of(samples), problem, contact_.state.solver.memory);

  remove_suction(problem);  // the haptic loop has its own, in each of its ticks
  thin(samples);
  problem.thinned = problem.thinned || any_thinned(bodies_);
  flow(samples, report);

  // What will be cut next is not foreseen, nor where what touches will be; and a cut starts the step afresh.
  const bool ahead = looked_ahead_ = prediction_.active() && !report.split && !contacts().any();
  factors_.renew(context_, ahead, report);
  if (settings_.fresh_free_motion) contact_.place(context_, problem);
  body_contact_.condense(bodies_, contact_.state.patch_force, problem, report);
  if (ahead) {
    draw(samples, problem);
    const std::vector<int> foreseen =
        prediction_.foresee(context_, factors_, problem, samples, contact_.state.solver, removing_);
    remove_suction(problem);
    if (remove_ahead(foreseen, samples, report)) gather(samples, true, problem, report);
    for (const int b : foreseen) prediction_.linearise(context_, factors_, b, samples, report);
    contact_.condense(context_, factors_, samples, problem, report);
    contact_.place(context_, problem);
  }
  publish_contact(samples, problem);
  copy_in_use(problem, *published_.problem);
  report_compliance(report);
  put_to_sleep();
  return report;
}

// The pumps' vacuum on what their ports cover: where the last solve left tips and tissue, as either goes on
// from there. Returns how far they are covered.
EachInstrument<double> World::draw(const InstrumentSamples& samples, CondensedProblem& problem) {
  if (!any_port(instruments_)) return {};
  const InstrumentPoses next =
      start_coupling(problem, poses_of(samples), settings_.h, contact_.state.solver.coupling_offset).X_start;
  InstrumentPoses X = next;
  for (int i = 0; i < max_instruments; ++i)
    if (X.present[i] && placed_.present[i]) X[i] = placed_[i];
  return drawing_.begin(instruments_, samples, X, next, problem);
}

void World::publish_contact(const InstrumentSamples& samples, CondensedProblem& problem) {
  const auto x_free = problem.x_free;
  draw(samples, problem);
  contact_.publish_contact(context_, samples, report_.contact.active > 0, problem);
  remove_suction(problem);
  problem.x_free = x_free;  // to the last bit
}

// Where they will be, so much later.
InstrumentPoses World::poses_in(const InstrumentSamples& samples, double time) const {
  return displaced(poses_of(samples), motion_.twist(), time);
}

void World::remove(const InstrumentSamples& samples, StepReport& report) {
  const Within collision(context_.times(), StepPart::collision);
  const Removed removed = removal_.remove(bodies_, instruments_, samples, poses_in(samples, removal_lead));
  follow_removal(removed, report);
  removing_ = std::exchange(removed_ahead_, false) || removed.tets > 0;
}

void World::find_near(const InstrumentSamples& samples) {
  const Within collision(context_.times(), StepPart::collision);
  collision_.near_faces(poses_of(samples), near_);
  near_found_ = true;
}

// Where no instrument has moved since the start of the step, what is near may be known.
void World::look_again(const InstrumentSamples& samples) {
  if (!near_found_ || !motion_.are_at(samples)) find_near(samples);
}

// What the tips take by the middle of the use of the problem that this step ends with goes with it: else the
// next step begins with an interim problem and a factor of its own.
bool World::remove_ahead(std::span<const int> foreseen, const InstrumentSamples& samples,
                         StepReport& report) {
  const Within collision(context_.times(), StepPart::collision);
  if (!removes_often(settings_)) return false;
  for (const Body& b : bodies_)
    if (b.removable && !b.model.corotational) return false;  // is not linearised anew
  const Removed removed =
      removal_.remove_ahead(bodies_, instruments_, samples, poses_in(samples, settings_.lead));
  follow_removal(removed, report);
  if (removed.tets == 0) return false;
  for (const int b : foreseen) removal_.tell_compliance(bodies_, b);
  find_near(samples);
  report.removed_ahead = removed.tets;
  return removing_ = removed_ahead_ = true;
}

void World::follow_removal(const Removed& removed, StepReport& report) {
  report.removed += removed.tets;
  report.fragments_aspirated += removed.fragments_aspirated;
  if (removed.by_tips) {
    lumen_ = removed.lumen;
    passed_ = removed.passed;
  }
  report.lumen = lumen_;
  if (removed.tets == 0) return;
  surfaces_changed(removed.bodies);
  regions_.follow(bodies_, removal_.gone());
  cutting_.follow(bodies_, removed.bodies);
}

// Fluid goes into the ports as far as tissue leaves them open, and what was sucked in takes its place.
void World::flow(const InstrumentSamples& samples, StepReport& report) {
  bool pumps = false;
  for (std::size_t k = 0; k < instruments_.size(); ++k) {
    const int i = static_cast<int>(k);
    const double through = flow_into(instruments_[k].port, samples[i], report.occlusion[i]);
    report.flow[i] = std::max(0.0, through - passed_[i] / settings_.h);
    pumps = pumps || instruments_[k].port.flow > 0;
  }
  if (pumps) carry_along(bodies_, instruments_, poses_of(samples), report.flow, settings_.h);
}

// By as much as is gone in the middle of the use of the problem that this step ends with.
void World::thin(const InstrumentSamples& samples) {
  for (Body& body : bodies_) body.thinned = false;
  for (const int b : removal_.thin(bodies_, instruments_, samples, poses_of(samples),
                                   settings_.lead > 0 ? settings_.lead : settings_.h)) {
    bodies_[b].thinned = true;
    bodies_[b].asleep = false;
  }
}

// Fronts that advanced since the last step are cut into the mesh. Crumbs that then hang go in the next step.
bool World::cut(StepReport& report) {
  const Within collision(context_.times(), StepPart::collision);
  const std::vector<int> split = cutting_.realise(bodies_, instruments_);
  surfaces_changed(split);
  for (const int b : split) removal_.schedule_hinged(bodies_, b, cutting_.around_parted(bodies_, b));
  report.split = !split.empty();
  report.out_of_room = cutting_.out_of_room();
  return report.split;
}

void World::look_for_cracks() {
  const Within collision(context_.times(), StepPart::collision);
  cutting_.look_for_cracks(bodies_);
}

void World::surfaces_changed(std::span<const int> bodies) {
  for (const int b : bodies) {
    collision_.set_surface(b, bodies_[b].surface.faces(), bodies_[b].state.x);
    body_contact_.surface_changed(bodies_, b);
    near_found_ = false;  // faces have other numbers
  }
}

// What sleeps and comes near is woken where it is gathered; of bodies that touch others, before their contact
// is looked for.
void World::refit() {
  const Within collision(context_.times(), StepPart::collision);
  for (int b = 0; b < context_.body_count(); ++b)
    if (is_awake(bodies_[b]) && removal_.gone()[b].empty()) collision_.refit(b, bodies_[b].state.x);
  near_found_ = false;
  if (contacts().empty()) return;
  find_near(begun_with_);
  for (const NearFace& f : near_) bodies_[f.body].asleep = false;
}

bool World::fill_interim(const InstrumentSamples& samples, CondensedProblem& problem, StepReport& report) {
  if (!published_.any() || !has_interim_problem(context_, removal_.gone(), samples)) return false;
  const Within condense(context_.times(), StepPart::condense);
  const auto nodes = contact_.patch().nodes();
  PatchForce pressed{{nodes.begin(), nodes.end()}, VecX::Zero(3 * static_cast<Eigen::Index>(nodes.size()))};
  const InstrumentPoses then = poses_in(samples, removal_lead);
  if (usable(published_.solve(context_, then, contact_.state.solver)))
    pressed.force = force_on_patch(*published_.problem, *published_.scratch);
  if (!near_found_) find_near(samples);
  gather(samples, true, problem, report);
  return fill_interim_problem(context_, removal_.gone(), pressed, problem);
}

void World::gather(const InstrumentSamples& samples, bool topology_changed, CondensedProblem& problem,
                   StepReport& report) {
  const Within collision(context_.times(), StepPart::collision);
  // The instrument may have come within reach of a sleeping body since the start of the step.
  for (const NearFace& f : near_) {
    Body& body = bodies_[f.body];
    if (!body.deformable || !body.asleep) continue;
    body.asleep = false;
    factors_.follow(context_, f.body, samples, {});
    factors_.factor(context_, f.body, report);
  }
  const InstrumentPoses X = poses_of(samples);
  cutting_.find(bodies_, instruments_, X, settings_.alarm_distance);
  contact_.gather(context_, X, near_, cutting_.nodes(), topology_changed, problem);
  problem.thinned = any_thinned(bodies_);  // at the end of the step before: what is spent goes in this one
  cutting_.publish(bodies_, instruments_, contact_.patch(), problem);
}

// Nodes that the last contact solve pressed and that nothing alive moves with.
int World::pressed_condensed_nodes() const {
  const auto nodes = contact_.patch().nodes();
  const VecX& force = contact_.state.patch_force;
  int count = 0;
  for (std::size_t k = 0; k < nodes.size() && 3 * static_cast<Eigen::Index>(k) < force.size(); ++k) {
    const Body& body = bodies_[nodes[k].body];
    count += body.model.condensed && body.state.live_tets_of_node[nodes[k].node] == 0 &&
             !force.segment<3>(3 * static_cast<Eigen::Index>(k)).isZero(0);
  }
  return count;
}

// What the problem published last says at these poses, where another reference factor or surface may make a
// jump.
std::optional<EachInstrument<Vec6>> World::wrenches_before_handover(const InstrumentSamples& samples,
                                                                    const StepReport& report) const {
  const bool compares = any_present(samples) && keeps_references(settings_) && published_.any() &&
                        (report.references_adopted > 0 || report.removed > 0);
  if (!compares) return {};
  const Within solve(context_.times(), StepPart::solve);
  return published_.solve(context_, poses_of(samples), contact_.state.solver).wrench;
}

void World::report_compliance(StepReport& report) {
  for (int b = 0; b < context_.body_count(); ++b) {
    if (!is_awake(bodies_[b])) continue;
    report.compliance.push_back({b, bodies_[b].compliance->report()});
    factors_.references.end_step(
        b, report.compliance.back().compliance.wants_reference || bodies_[b].energy.bounded_steps > 0);
  }
}

void World::put_to_sleep() {
  std::vector<std::uint8_t> still(bodies_.size(), 1);
  for (std::size_t b = 0; b < bodies_.size(); ++b)
    if (bodies_[b].deformable)
      still[b] = at_rest(bodies_[b]) && bodies_[b].state.load.empty() && !is_near(near_, static_cast<int>(b));
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    if (!bodies_[b].deformable) continue;
    bodies_[b].asleep = still[b];
    for (std::size_t c = 0; still[b] && contacts().any() && c < bodies_.size(); ++c)
      if (!still[c] && contacts().touching(static_cast<int>(b), static_cast<int>(c)))
        bodies_[b].asleep = false;
  }
}

std::vector<ReferenceJob> World::wanted_references() {
  std::vector<ReferenceJob> jobs = factors_.references.wanted(bodies_);
  regions_.wanted(context_, jobs);
  return jobs;
}

void World::adopt(ReferenceJob job) {
  if (job.kind == JobKind::reference)
    factors_.references.adopt(std::move(job));
  else
    regions_.adopt(std::move(job));
}

bool World::refresh(const InstrumentSamples& samples, CondensedProblem& problem) {
  if (!any_present(samples) || !motion_.poses().any() || !wants_refresh() || !published_.any()) return false;
  CondensedProblem& last = *published_.problem;
  const InstrumentPoses X = poses_in(samples, middle_of_refresh * settings_.h);
  const ContactSolution contact = prediction_.solve(context_, last, X, contact_.state.solver, removing_);
  if (!usable(contact) || contact.active == 0) return false;
  if (!refresh_.apply(context_, prediction_.force(last), last)) return false;
  last.step = contact_.next_number();
  last.topology_changed = false;
  copy_in_use(last, problem);
  return true;
}

ContactSolution World::solve_unfrozen(const InstrumentSamples& samples, const CondensedProblem& published) {
  const auto problem = std::make_unique<CondensedProblem>(published);
  const InstrumentContactState before = contact_.state;
  StepReport report;
  set_patch_positions(bodies_, contact_.patch().nodes(), *problem);
  contact_.condense(context_, factors_, samples, *problem, report);
  body_contact_.solve_once(context_, factors_, contact_, samples, *problem, {}, false, report);
  contact_.state = before;
  return report.contact;
}

}  // namespace hapticd
