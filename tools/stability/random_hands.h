// One or several hands at random in one tissue: each strays (stray.h) and loses states; a lens is sculpted by
// the first, a block is cut by its blade.
//
// They meet tissue and one another anywhere. Watched: trial_tally.h; of a blade, that the mesh is valid
// (mesh_check.h); over all: the energy that the renderer made, of all ports together, for the devices scale
// alike:
//   E = −Σ_i ∫ F_i·dx_i + τ_i·dθ_i,   made = −min E
// A hand turns its stylus as it is told, through its port. The scenes' devices display no torque, but what
// moves and turns an instrument puts in both, so that τ is the torque as rendered. `made_by_force` leaves the
// turning out: it is what such a device lets the hand feel, and may be above zero of any spring that is
// turned for nothing. Fresh tissue every episode. Deterministic, on however many cores. Units: SI.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/scene/scene.h"
#include "server/schedule/virtual_link.h"
#include "tools/stability/bench/stray.h"
#include "tools/stability/bench/trial_tally.h"

namespace hapticd {

struct RandomSettings {
  std::int64_t ticks = 1'000'000;
  std::int64_t episode = 40'000;
  std::uint64_t seed = 1;
  bool passivity_control = false;
  std::optional<LinkTrouble> link;          // hands_daemon.h; an episode's seed is its own
  EachInstrument<bool> at_simulation = {};  // …
  double problem_old = 0;                   // …
  double late_steps = 0;                    // their spread (late_steps.h); 0: each takes the usual time
};

struct RandomReport : TrialTally {
  int hands = 1;
  bool passivity_control = false;
  double late_steps = 0;                           // their spread
  double cut_area = 0;                             // by blades [m²]
  int nodes_added = 0;                             // … by cuts, all episodes
  int out_of_room = 0;                             // episodes that ended without room for more
  std::int64_t both_in_contact = 0, touching = 0;  // ticks
  double made = 0;                                 // largest of the episodes' [J]
  double made_by_episode = 0;                      // … their mean [J]
  double made_by_force = 0;                        // … largest, turning left out [J]
  double made_at_hand = 0;                         // … and at one hand alone, largest [J]
  double absorbed = 0;                             // E at the end, all episodes [J]
  double controlled_force_max = 0;                 // the controller's own, on a device [N]
  double controlled_work = 0;                      // … what it took out, all episodes [J]
  double controlled_force_rms = 0;                 // … over all ticks [N]
  std::int64_t faulty = 0;                         // what broke a bound: so often …
  std::vector<std::string> faults;                 // … the first of each episode
};

// hands: of the scene's instruments the first so many. `progress(fraction)` returns false to stop.
RandomReport run_random(const Scene& scene, const std::vector<StrayingHand>& hands,
                        const RandomSettings& settings, const std::function<bool(double)>& progress);

}  // namespace hapticd
