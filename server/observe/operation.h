// What a trainer asks of an operation: how long, how far, how much went, and what was touched how hard.
//
//   hands[]   path of the tip [m], times touching, emulsifying, aspirating [s], largest force [N],
//             vacuum of its port now [Pa], flow of fluid into it now [m³/s] and so far [m³], time that it
//             was covered to four fifths with the pedal down [s]; of its incision the largest force [N]
//             and stretch [m]
//   bodies[]  share of its volume that is gone, pieces it has come to and most of them, smaller crumbs,
//             how many of all are loose, largest strain, time touched [s], largest force of a touch [N]
//   events[]  operation_events.h
//
// Measured after each step, which stands for the time since the one before, more than a period where the
// simulation is late. Strain: equivalent_strain (strain.h), the largest of any live tetrahedron.
// Units: scene units. Threads: `follow` belongs to one, `measures` to any. Cost: a pass over awake
// bodies' tetrahedra a step.
#pragma once

#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "physics/simulation/world.h"
#include "server/observe/operation_events.h"

namespace hapticd {

inline constexpr double crumb_share = 0.01;  // of a body's first volume: what is smaller is a crumb

struct HandMeasures {
  double path = 0, touching = 0, emulsifying = 0, aspirating = 0, force_most = 0, vacuum = 0;
  double flow = 0, fluid = 0, occluded = 0;
  double incision_force = 0, incision_stretch = 0;
};

struct BodyMeasures {
  std::string name;
  bool deformable = false;
  double volume = 0, volume_gone = 0;  // [m³]
  int pieces = 0, pieces_most = 0, crumbs = 0, loose = 0;
  double strain_most = 0;
  double touched = 0, touch_most = 0;
};

struct OperationMeasures {
  double time = 0;  // [s]
  std::vector<HandMeasures> hands;
  std::vector<BodyMeasures> bodies;
  std::vector<OperationEvent> events;
  std::int64_t events_left_out = 0;
};

class Operation {
 public:
  explicit Operation(const World& world);

  // After each step of the world: what it reported and was given, so long after the step before [s].
  void follow(const World& world, const StepReport& report, const InstrumentSamples& samples, double elapsed);
  OperationMeasures measures() const;  // after the newest step
  // The same with the newest event alone; returns how many there were. Into memory that was used before it
  // allocates nothing.
  std::uint64_t newest(OperationMeasures& into) const;

 private:
  void follow_hands(const World& world, const StepReport& report, const InstrumentSamples& samples);
  std::vector<double> follow_touches(const World& world);  // the force on each body

  double elapsed_ = 0;  // of the newest step
  OperationMeasures measures_;
  mutable std::mutex mutex_;
  OperationEvents events_;              // by the mutex
  OperationMeasures shown_;             // by the mutex
  std::vector<Vec3> tip_, tip_before_;  // in the instrument's frame, in the scene
  std::vector<char> seen_;              // the instrument was there in the step before
};

nlohmann::ordered_json to_json(const OperationMeasures& measures);

}  // namespace hapticd
