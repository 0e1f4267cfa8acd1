// What happened in an operation, and when: a list that a trainer reads from top to bottom.
//
//   crack      a body is cut or tears, after half a second without; value: its pieces then
//   rupture    the same, of a body that the tip may not destroy
//   pieces     a body has come to more pieces than ever; value: how many
//   gone       a quarter, half, three quarters, nine tenths of a body are gone; value: the share
//   aspirated  fragments were sucked out; value: how many, in this step
//   too_wide   what is before a port does not pass its lumen, after half a second without; value: the radius
//              that it would need, at least [m]
//   passed     what was sucked in is through the lumen, where that took more than a step; value: [s]
//   occluded   a pump draws four fifths of its largest vacuum: tissue covers the port; value: [Pa]
//   vented     … it has fallen to a fifth; value: [Pa]
//   touched    a body that the tip may not destroy is touched, after half a second without; value: [N]
//
// Units: s, scene units. At most `most_events` are kept, the first ones; the rest is counted.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "physics/simulation/world.h"

namespace hapticd {

struct BodyMeasures;

inline constexpr std::size_t most_events = 2000;

struct OperationEvent {
  double time = 0;
  const char* what = "";
  std::string who;  // a body, or a hand's number
  double value = 0;
};

class OperationEvents {
 public:
  explicit OperationEvents(const World& world);

  // After a step at this time; of each body what was measured then, and the force of its touch in this step.
  void follow(double time, const World& world, const StepReport& report, const InstrumentSamples& samples,
              const std::vector<BodyMeasures>& bodies, const std::vector<double>& touch);

  const std::vector<OperationEvent>& all() const { return events_; }
  std::int64_t left_out() const { return left_out_; }

 private:
  struct Seen {                                  // of a body
    int topology = 0, pieces = 0, quarters = 0;  // pieces of 0: not looked at yet
    double torn = -1e9, touched = -1e9;          // when last [s]
  };
  void add(double time, const char* what, std::string who, double value);
  void follow_body(double time, const Body& body, const BodyMeasures& now, double touch, Seen& seen);

  std::vector<Seen> bodies_;
  struct Bore {  // of a hand's port
    bool occluded = false;
    double too_wide = -1e9, entered = 0;  // when last [s]
    int steps = 0;                        // that something has been on its way through
  };
  void follow_bore(double time, std::size_t hand, const Port& port, const StepReport& report,
                   const InstrumentSample& sample, Bore& bore);

  std::vector<Bore> bores_;
  std::vector<OperationEvent> events_;
  std::int64_t left_out_ = 0;
};

nlohmann::ordered_json to_json(const std::vector<OperationEvent>& events);

}  // namespace hapticd
