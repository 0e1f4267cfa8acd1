// What a link to an edge would carry for a scene, and what it costs in force: in virtual time, without a
// network.
//
// The scene runs along its own trajectories twice, with each problem as it is and as it would arrive (packed
// and read, server/edge/edge_problem.h); the simulations are the same to the last bit, so forces differ by
// the packing alone. Removals are those of the scene's pedals. Units: N, bytes. Errors: InputError where the
// scene has no trajectory; what run_offline throws.
#pragma once

#include <vector>

#include "server/scene/scene.h"
#include "server/schedule/virtual_link.h"

namespace hapticd {

struct PatchTraffic {
  int nodes_from = 0, nodes_to = 0;  // of the patch
  std::size_t problems = 0;
  double mean_bytes = 0, mbit_at_rate = 0;  // one problem of such a patch in each step
  int samples_max = 0;
};

// A link's cost in force, of the hand that is worst off, over the peak.
struct LinkCost {
  LinkTrouble link;
  double force_rms_rel = 0, tanked_rms_rel = 0;  // without the tank (haptic/passivity.h), and with it
};

struct EdgeTrial {
  double seconds = 0, rate = 0;  // of the run; of the simulation [1/s]
  std::size_t problems = 0;      // refreshes and interims too
  double mbit = 0;               // of all problems [Mbit/s]
  double mbit_steps = 0;         // … one a step: its mean size at the scene's rate
  double mbit_peak = 0;          // … of the second that carries most
  double force_rms_rel = 0;      // of the difference, over the peak force; the hand that is worst off
  double force_max_rel = 0;
  double force_peak = 0;    // [N], of that hand
  std::size_t refused = 0;  // problems that were not read back: none
  std::vector<PatchTraffic> patches;
  std::vector<LinkCost> links;
};

// seconds: of the trajectories, at most; 0: all.
EdgeTrial try_edge(const Scene& scene, double seconds);

}  // namespace hapticd
