#include "server/observe/operation_events.h"

#include <array>
#include <utility>

#include "server/observe/operation.h"

namespace hapticd {
namespace {

constexpr double apart = 0.5;  // [s] of one event from the next of its kind
constexpr std::array<double, 4> shares{0.25, 0.5, 0.75, 0.9};
constexpr double covered = 0.8, open = 0.2;  // of the largest vacuum

}  // namespace

OperationEvents::OperationEvents(const World& world) : bores_(world.instruments().size()) {
  for (const Body& body : world.bodies()) bodies_.push_back({.topology = body.topology});
}

void OperationEvents::add(double time, const char* what, std::string who, double value) {
  if (events_.size() < most_events)
    events_.push_back({time, what, std::move(who), value});
  else
    ++left_out_;
}

void OperationEvents::follow(double time, const World& world, const StepReport& report,
                             const InstrumentSamples& samples, const std::vector<BodyMeasures>& bodies,
                             const std::vector<double>& touch) {
  for (std::size_t b = 0; b < bodies_.size(); ++b)
    follow_body(time, world.bodies()[b], bodies[b], touch[b], bodies_[b]);
  if (report.fragments_aspirated > 0) add(time, "aspirated", "", report.fragments_aspirated);
  for (std::size_t i = 0; i < bores_.size(); ++i)
    follow_bore(time, i, world.instruments()[i].port, report, samples[static_cast<int>(i)], bores_[i]);
}

void OperationEvents::follow_bore(double time, std::size_t hand, const Port& port, const StepReport& report,
                                  const InstrumentSample& sample, Bore& bore) {
  const LumenState& lumen = report.lumen[static_cast<int>(hand)];
  if (lumen.passing > 0) {
    if (bore.steps++ == 0) bore.entered = time;
  } else if (std::exchange(bore.steps, 0) > 1) {
    add(time, "passed", std::to_string(hand), time - bore.entered);
  }
  if (lumen.too_wide > 0) {
    if (time - bore.too_wide > apart) add(time, "too_wide", std::to_string(hand), lumen.too_wide);
    bore.too_wide = time;
  }
  if (port.vacuum > 0 && sample.vacuum > (bore.occluded ? open : covered) * port.vacuum) {
    if (!std::exchange(bore.occluded, true)) add(time, "occluded", std::to_string(hand), sample.vacuum);
  } else if (std::exchange(bore.occluded, false)) {
    add(time, "vented", std::to_string(hand), sample.vacuum);
  }
}

void OperationEvents::follow_body(double time, const Body& body, const BodyMeasures& now, double touch,
                                  Seen& seen) {
  if (std::exchange(seen.topology, body.topology) != body.topology) {
    if (time - seen.torn > apart) add(time, body.removable ? "crack" : "rupture", body.name, now.pieces);
    seen.torn = time;
  }
  if (seen.pieces > 0 && now.pieces > seen.pieces) add(time, "pieces", body.name, now.pieces);
  seen.pieces = std::max(seen.pieces, now.pieces);
  const double share = now.volume > 0 ? now.volume_gone / now.volume : 0;
  for (; seen.quarters < std::ssize(shares) && share >= shares[static_cast<std::size_t>(seen.quarters)];
       ++seen.quarters)
    add(time, "gone", body.name, share);
  if (!body.removable && touch > 0) {
    if (time - seen.touched > apart) add(time, "touched", body.name, touch);
    seen.touched = time;
  }
}

nlohmann::ordered_json to_json(const std::vector<OperationEvent>& events) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const OperationEvent& e : events)
    json.push_back({{"time_s", e.time}, {"what", e.what}, {"who", e.who}, {"value", e.value}});
  return json;
}

}  // namespace hapticd
