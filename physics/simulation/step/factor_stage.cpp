#include "physics/simulation/step/factor_stage.h"

#include <algorithm>
#include <utility>

#include "physics/simulation/step/zone_selection.h"

namespace hapticd {
namespace {

// Steps in a row that a stale compliance may have made energy in. One bounds the motion, and asks for a
// reference factor; a step that made it itself would leave the loop without a problem for longer.
constexpr int most_bounded = 25;
constexpr double most_plausible = 2;  // edges that a free motion takes a node without being looked into
constexpr double far = 0.5;           // … of a node that joins the zone where it was not plausible
constexpr std::size_t most_far = 80;  // nodes
constexpr int most_left_out = 8;      // of the nodes needed, by a zone that stays

int not_covered(const Compliance& compliance, std::span<const int> nodes) {
  return static_cast<int>(std::count_if(
      nodes.begin(), nodes.end(), [&](const int& n) { return !compliance.zone_covers(std::span(&n, 1)); }));
}

}  // namespace

FactorStage::FactorStage(const WorldSettings& settings, std::size_t bodies)
    : references(bodies),
      keeps_references_(keeps_references(settings)),
      factors_in_step_(settings.compliance == ComplianceMethod::exact),
      predicts_(predicts(settings)) {}

void FactorStage::run(const StepContext& c, const InstrumentSamples& samples, StepReport& report) {
  for (int b = 0; b < c.body_count(); ++b) {
    if (!is_awake(c.bodies[b])) continue;
    const bool settled = factors_in_step_ && c.bodies[b].free.ahead;  // with the zone of the step before
    if (!settled && (any_present(samples) || !c.contacts.nodes_of(b).empty())) follow(c, b, samples, {});
    ++report.awake_bodies;
    if (!c.bodies[b].free.ahead)
      factor(c, b, report);
    else if (c.contacts.any())
      finish_free_motion(c.bodies[b], nullptr);
  }
}

void FactorStage::renew(const StepContext& c, bool looks_ahead, StepReport& report) {
  const double h = c.settings.h;
  for (int b = 0; b < c.body_count(); ++b) {
    Body& body = c.bodies[b];
    if (!is_awake(body)) continue;
    if (!c.settings.fresh_free_motion) {
      update_rotations(body.model, body.state);
      continue;
    }
    if (looks_ahead && foresees(body)) {
      foresee_free_motion(body, h);  // what comes of it is looked into by the prediction
    } else {
      fresh_free_motion(body, h);
      make_plausible(c, b, report);
    }
    if (!c.contacts.empty()) finish_free_motion(body, nullptr);
  }
}

void FactorStage::factor(const StepContext& c, int b, StepReport& report) {
  Body& body = c.bodies[b];
  if (predicts_) {
    const Within assembly(c.times(), StepPart::assembly);
    update_rotations(body.model, body.state);  // they are of where it was thought to be
  }
  body.compliance->update(body.state);
  compute_free_motion(body, c.settings.h);
  if (keeps_references_ && body.energy.bounded_steps >= most_bounded) {
    make_reference(c, b, report);
    compute_free_motion(body, c.settings.h);
  } else {
    make_plausible(c, b, report);
  }
  if (!c.contacts.empty()) finish_free_motion(body, nullptr);  // of any node that may meet another body
}

bool FactorStage::foresees(const Body& body) const {
  return predicts_ && body.free.in_halves && !body.thinned && body.model.corotational &&
         body.model.material.law != Law::guarded;
}

void FactorStage::follow(const StepContext& c, int b, const InstrumentSamples& samples,
                         std::span<const int> nodes) {
  // While a reference factor is being made, no new zone is chosen; the next one is, when it is adopted.
  if (keeps_references_ && references.progress(b).under_way) return;
  // What is near now is where the instrument is no more when a reference factor made elsewhere comes into
  // use.
  const InstrumentPoses X = poses_of(samples);
  const bool covered = keeps_references_ ? move_zone(c, b, X, {}, nodes) : move_zone(c, b, X, nodes, nodes);
  if (!covered) references.want(b);
  if (!covered && !keeps_references_ && !factors_in_step_) c.bodies[b].free.ahead = false;
}

// Returns whether the zone that the compliance has covers what is needed.
bool FactorStage::move_zone(const StepContext& c, int b, const InstrumentPoses& X, std::span<const int> first,
                            std::span<const int> needed) const {
  const Within collision(c.times(), StepPart::collision);
  Compliance& compliance = *c.bodies[b].compliance;
  const Zone zone =
      select_zone(c.bodies[b], {c.instruments, c.motion, X, c.settings.alarm_distance, keeps_references_,
                                references.progress(b).last_steps, first, needed, c.contacts.nodes_of(b)});
  // Few nodes left out cost less than the plan of another zone.
  const bool covered = not_covered(compliance, zone.needed) <= (factors_in_step_ ? most_left_out : 0);
  // A zone for the next reference factor may follow the instrument at every step; one that is factored here
  // may not.
  if (!keeps_references_ && covered) return true;
  compliance.move_zone(zone.nodes);
  if (c.bodies[b].references) c.bodies[b].references->move_halo(zone.halo);
  return covered;
}

void FactorStage::cover(const StepContext& c, int b, const InstrumentSamples& samples,
                        std::span<const int> nodes, StepReport& report) {
  Body& body = c.bodies[b];
  if (not_covered(*body.compliance, nodes) <= (factors_in_step_ ? most_outside : 0)) return;
  // The instrument outran the zone within one step: factor again with the zone where it is now, or ask for
  // a reference factor there and meanwhile pay for a half solve per node.
  follow(c, b, samples, nodes);
  if (factors_in_step_ || body.compliance->zone_covers(nodes)) return body.compliance->update(body.state);
  std::vector<int> uncovered;
  for (const int n : nodes)
    if (!body.compliance->zone_covers(std::span(&n, 1))) uncovered.push_back(n);
  report.uncovered_nodes += static_cast<int>(uncovered.size());
  if (!body.references) return;
  body.references->extend_zone(uncovered);
  if (!body.asleep) return;  // an update is due soon
  finish_free_motion(body, nullptr);
  body.compliance->update(body.state);
  body.free.ahead = false;
}

// Tissue let go springs back by an edge in a step, not by many. Where elements outside the zone have turned
// far since the reference factor, it has next to no stiffness against what they do, and what a step gets
// wrong of them the next gets wrong by several times as much: a reference factor that comes late lets the
// tissue burst. The half that a step leaves out is looked into where the step before took a node by an edge.
bool FactorStage::plausible(const StepContext& c, Body& body) const {
  if (!keeps_references_) return true;
  const auto within = [&](double edges) {
    double largest = 0;
    body.model.each_node(
        [&](int n) { largest = std::max(largest, body.free.dx.segment<3>(3 * n).squaredNorm()); });
    return largest <= edges * edges * body.edge * body.edge;
  };
  if (body.free.forward_solved) {
    const double fast = body.edge / c.settings.h;
    const bool slow = std::all_of(body.state.v.begin(), body.state.v.end(),
                                  [&](const Vec3& v) { return v.squaredNorm() < fast * fast; });
    if (slow && within(most_plausible)) return true;
    finish_free_motion(body, nullptr);
  }
  return within(most_plausible) || !body.references ||
         body.references->disagreement(body.state, body.free.dx) < 1;
}

// The far field is stale where tissue moved far; a flap that a blade left has few nodes.
bool FactorStage::extend_where_far(Body& body) {
  std::vector<int> nodes;
  for (int n = 0; n < body.model.nodes_in_use; ++n) {
    const bool moves_far = body.free.dx.segment<3>(3 * n).squaredNorm() > far * far * body.edge * body.edge;
    if (moves_far && !body.compliance->zone_covers(std::span(&n, 1))) nodes.push_back(n);
  }
  if (nodes.empty() || nodes.size() > most_far || !body.references) return false;
  body.references->extend_zone(nodes);
  body.compliance->update(body.state);
  return true;
}

void FactorStage::make_plausible(const StepContext& c, int b, StepReport& report) {
  Body& body = c.bodies[b];
  if (plausible(c, body)) return;
  if (extend_where_far(body)) {
    compute_free_motion(body, c.settings.h);
    if (plausible(c, body)) return;
  }
  make_reference(c, b, report);
  compute_free_motion(body, c.settings.h);
}

void FactorStage::make_reference(const StepContext& c, int b, StepReport& report) {
  Body& body = c.bodies[b];
  move_zone(c, b, c.motion.poses(), c.patch.nodes_of(b), {});
  if (!body.references) return;
  std::unique_ptr<ReferenceFactor> reference = body.references->snapshot_reference(body.state);
  reference->make();
  body.references->adopt_reference(std::move(reference), body.state);
  body.compliance->update(body.state);
  references.made_by_step(b);
  ++report.synchronous_references;
}

}  // namespace hapticd
