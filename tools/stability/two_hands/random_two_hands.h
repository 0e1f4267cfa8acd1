// Two hands at random in one lens: each strays (stray.h) through the scene two_hands, the first cuts, both
// lose states.
//
// They meet tissue and one another anywhere. Watched in each tick: finite forces within the devices' maximum
// and slew; after each step: tissue_watch.h; over all: the energy that the renderer made, of both ports
// together, for both devices scale alike. `hands` 1: the same first hand without the second. A fresh lens
// every episode. Deterministic, on however many cores. Units: SI.
#pragma once

#include <string>

#include "tools/stability/stability_random.h"

namespace hapticd {

struct TwoHandsReport {
  int hands = 2;
  std::int64_t ticks = 0, steps = 0;
  std::int64_t in_contact = 0, both_in_contact = 0, touching = 0;  // ticks
  std::int64_t latched = 0, saturated = 0, solver_caps = 0;        // ticks of a hand
  int removed = 0;
  double force_max = 0, device_max = 0;  // [N]
  double made = 0;             // −least of the energy that both put in, largest of the episodes' [J]
  double made_by_episode = 0;  // … their mean [J]
  double absorbed = 0;         // … at the end, all episodes [J]
  double farthest = 0, farthest_allowed = 0;  // [m]
  double fastest = 0, fastest_allowed = 0;    // [m/s]
  double gained = 0, energy = 0;    // by a piece in a step beyond the work done on it; of the largest [J]
  std::int64_t faulty = 0;          // what broke a bound: so often …
  std::vector<std::string> faults;  // … the first of each episode
};

TwoHandsReport run_random_two(const Scene& two_hands, int hands, const RandomSettings& settings,
                              const std::function<bool(double)>& progress);

}  // namespace hapticd
