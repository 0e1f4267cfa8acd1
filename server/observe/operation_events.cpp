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

OperationEvents::OperationEvents(const World& world) : occluded_(world.instruments().size(), 0) {
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
  for (std::size_t i = 0; i < occluded_.size(); ++i) {
    const InstrumentSample& sample = samples[static_cast<int>(i)];
    const double most = world.instruments()[i].port.vacuum;
    if (most > 0 && sample.vacuum > (occluded_[i] ? open : covered) * most) {
      if (!std::exchange(occluded_[i], char{1})) add(time, "occluded", std::to_string(i), sample.vacuum);
    } else if (std::exchange(occluded_[i], char{0})) {
      add(time, "vented", std::to_string(i), sample.vacuum);
    }
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
