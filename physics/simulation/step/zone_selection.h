// Which nodes a compliance is to keep at hand: those that patches will be made of.
//
// With a factor made in the step, the zone is what is near the instruments now. With a reference factor made
// elsewhere (`made_elsewhere`) it is what will be near while that factor is in use: along the instrument's
// way from its adoption to the adoption of the next. Units: m, steps. Errors: none.
#pragma once

#include <span>
#include <vector>

#include "physics/simulation/body.h"
#include "physics/simulation/step/instrument_motion.h"

namespace hapticd {

inline constexpr std::size_t max_zone_nodes = 200;

struct ZoneRequest {
  Instruments instruments;
  const InstrumentMotions& motion;
  InstrumentPoses X;
  double alarm_distance;  // [m]
  bool made_elsewhere;
  int last_steps;                      // that the last reference factor took
  std::span<const int> first;          // of the zone, and nearest
  std::span<const int> needed;         // it has to cover these
  std::span<const int> contact_nodes;  // and those that may meet other bodies
  std::span<const int> among = {};     // only of these; empty: of all that are simulated
};

struct Zone {
  std::vector<int> nodes;   // those that C is asked for first, of them the nearest: there it is cheapest
  std::vector<int> halo;    // next to them
  std::vector<int> needed;  // a zone that does not cover these is to move
};

Zone select_zone(const Body& body, const ZoneRequest& request);

}  // namespace hapticd
