#include "server/observe/operation.h"

#include <algorithm>

#include "physics/simulation/sample_id.h"
#include "physics/tissue/fragments.h"
#include "physics/tissue/strain.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

constexpr double covered_share = 0.8;  // of a port: tissue occludes it

double largest_strain(const Body& body) {
  double largest = 0;
  for (int t = 0; t < body.model.tets_in_use; ++t)
    if (body.state.alive[t])
      largest =
          std::max(largest, equivalent_strain(deformation_gradient(
                                corners_of(body.model.mesh.tets[t], body.state.x), body.model.gradients[t])));
  return largest;
}

double volume_left(const Body& body) {
  double volume = 0;
  for (int t = 0; t < body.model.tets_in_use; ++t)
    if (is_there(body.model, body.state, t)) volume += volume_left(body.model, body.state, t);
  return volume;
}

void count_pieces(const Body& body, BodyMeasures& of) {
  const Pieces pieces = find_pieces(body.model, body.state);
  std::vector<double> volume(static_cast<std::size_t>(pieces.count()), 0.0);
  for (int t = 0; t < body.model.tets_in_use; ++t)
    if (const int p = pieces.of_tet[t]; p >= 0)
      volume[static_cast<std::size_t>(p)] += volume_left(body.model, body.state, t);
  of.pieces = static_cast<int>(
      std::count_if(volume.begin(), volume.end(), [&](double v) { return v >= crumb_share * of.volume; }));
  of.crumbs = pieces.count() - of.pieces;
  of.pieces_most = std::max(of.pieces_most, of.pieces);
  of.loose = static_cast<int>(std::count(pieces.held.begin(), pieces.held.end(), char{0}));
}

// What one hand presses: its ring [N], stretched by so much [m], and whether anything else.
struct Pressed {
  double ring = 0, stretch = 0;
  bool others = false;
};
Pressed pressed_by(const ContactScratch& scratch, int hand) {
  Pressed of;
  const ContactRows& rows = scratch.rows;
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[static_cast<std::size_t>(i)];
    const double* lambda = &scratch.lambda[static_cast<std::size_t>(rows.rows_per_contact * i)];
    if (!(lambda[0] > 0) || (row.instrument != hand && row.other != hand)) continue;
    if (!row.incision) {
      of.others = true;
      continue;
    }
    of.ring = Eigen::Map<const VecX>(lambda, rows.rows_per_contact).norm();
    of.stretch = row.compliance * lambda[0];
  }
  return of;
}

}  // namespace

Operation::Operation(const World& world) : events_(world) {
  for (const Body& body : world.bodies()) {
    BodyMeasures of{.name = body.name, .deformable = body.deformable};
    if (body.deformable) {
      of.volume = volume_left(body);
      count_pieces(body, of);
    }
    measures_.bodies.push_back(std::move(of));
  }
  for (const Instrument& instrument : world.instruments())
    tip_.push_back(instrument.primitives[static_cast<std::size_t>(instrument.tip)].placement.p);
  measures_.hands.resize(tip_.size());
  tip_before_.resize(tip_.size());
  seen_.resize(tip_.size(), 0);
  shown_ = measures_;
}

OperationMeasures Operation::measures() const {
  const std::lock_guard lock(mutex_);
  OperationMeasures measures = shown_;
  measures.events = events_.all();
  measures.events_left_out = events_.left_out();
  return measures;
}

std::uint64_t Operation::newest(OperationMeasures& into) const {
  const std::lock_guard lock(mutex_);
  into.time = shown_.time;
  into.hands = shown_.hands;
  into.bodies = shown_.bodies;
  const std::vector<OperationEvent>& events = events_.all();
  into.events.clear();
  if (!events.empty()) into.events.push_back(events.back());
  return events.size() + static_cast<std::uint64_t>(events_.left_out());
}

void Operation::follow(const World& world, const StepReport& report, const InstrumentSamples& samples,
                       double elapsed) {
  elapsed_ = elapsed;
  measures_.time += elapsed_;
  follow_hands(world, report, samples);
  const std::vector<double> touch = follow_touches(world);
  for (std::size_t b = 0; b < measures_.bodies.size(); ++b) {
    const Body& body = world.bodies()[b];
    BodyMeasures& of = measures_.bodies[b];
    const bool changed = report.removed > 0 || report.split;
    if (!body.deformable || (body.asleep && !changed)) continue;
    of.strain_most = std::max(of.strain_most, largest_strain(body));
    of.volume_gone = of.volume - volume_left(body);
    if (changed) count_pieces(body, of);
  }
  const std::lock_guard lock(mutex_);
  events_.follow(measures_.time, world, report, samples, measures_.bodies, touch);
  shown_ = measures_;
}

void Operation::follow_hands(const World& world, const StepReport& report, const InstrumentSamples& samples) {
  for (std::size_t i = 0; i < measures_.hands.size(); ++i) {
    const InstrumentSample& sample = samples[static_cast<int>(i)];
    HandMeasures& hand = measures_.hands[i];
    const Vec3 tip = sample.pose.to_world(tip_[i]);
    if (sample.present && seen_[i]) hand.path += (tip - tip_before_[i]).norm();
    tip_before_[i] = tip;
    seen_[i] = sample.present;
    hand.vacuum = sample.vacuum;
    hand.flow = report.flow[static_cast<int>(i)];
    hand.fluid += elapsed_ * hand.flow;
    if (sample.aspiration && report.occlusion[static_cast<int>(i)] >= covered_share)
      hand.occluded += elapsed_;
    if (!sample.present) continue;
    const double force = report.contact.wrench[static_cast<int>(i)].head<3>().norm();
    const Pressed pressed = pressed_by(world.contact_scratch(), static_cast<int>(i));
    hand.touching += (pressed.ring > 0 ? pressed.others : force > 0) ? elapsed_ : 0;
    hand.incision_force = std::max(hand.incision_force, pressed.ring);
    hand.incision_stretch = std::max(hand.incision_stretch, pressed.stretch);
    hand.force_most = std::max(hand.force_most, force);
    hand.emulsifying += sample.phaco ? elapsed_ : 0;
    hand.aspirating += sample.aspiration ? elapsed_ : 0;
  }
}

// Of each body, the sum of the forces that press it.
std::vector<double> Operation::follow_touches(const World& world) {
  const ContactScratch& scratch = world.contact_scratch();
  const ContactRows& rows = scratch.rows;
  std::vector<Vec3> force(measures_.bodies.size(), Vec3::Zero());
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[static_cast<std::size_t>(i)];
    if (row.sample < 0) continue;
    Vec3 lambda = Vec3::Zero();
    for (int k = 0; k < rows.rows_per_contact; ++k)
      lambda[k] = scratch.lambda[static_cast<std::size_t>(rows.rows_per_contact * i + k)];
    force[static_cast<std::size_t>(body_of_sample(row.id))] += row.frame * lambda;
  }
  std::vector<double> touch;
  for (std::size_t b = 0; b < force.size(); ++b) {
    BodyMeasures& of = measures_.bodies[b];
    touch.push_back(force[b].norm());
    of.touched += touch[b] > 0 ? elapsed_ : 0;
    of.touch_most = std::max(of.touch_most, touch[b]);
  }
  return touch;
}

nlohmann::ordered_json to_json(const OperationMeasures& measures) {
  nlohmann::ordered_json json;
  json["time_s"] = measures.time;
  for (const HandMeasures& hand : measures.hands)
    json["hands"].push_back(
        {{"path_m", hand.path},
         {"touching_s", hand.touching},
         {"emulsifying_s", hand.emulsifying},
         {"aspirating_s", hand.aspirating},
         {"sim_force_most_n", hand.force_most},
         {"vacuum_pa", hand.vacuum},
         {"flow_ml_per_min", 6e7 * hand.flow},
         {"fluid_ml", 1e6 * hand.fluid},
         {"occluded_s", hand.occluded},
         {"incision",
          {{"sim_force_most_n", hand.incision_force}, {"stretch_most_m", hand.incision_stretch}}}});
  for (const BodyMeasures& body : measures.bodies) {
    nlohmann::ordered_json of{
        {"name", body.name}, {"touched_s", body.touched}, {"touch_most_n", body.touch_most}};
    if (body.deformable)
      of.update({{"volume_gone_share", body.volume > 0 ? body.volume_gone / body.volume : 0},
                 {"volume_gone_mm3", 1e9 * body.volume_gone},
                 {"pieces", body.pieces},
                 {"pieces_most", body.pieces_most},
                 {"crumbs", body.crumbs},
                 {"pieces_loose", body.loose},
                 {"strain_most", body.strain_most}});
    json["bodies"].push_back(std::move(of));
  }
  json["events"] = to_json(measures.events);
  if (measures.events_left_out > 0) json["events_left_out"] = measures.events_left_out;
  return json;
}

}  // namespace hapticd
