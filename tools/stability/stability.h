// Where methods fail, and where this one does: one parameter at a time is made worse until something breaks.
//
// A mode (stability_mode.h) has a parameter, what is judged, the limit beyond which it counts as broken, a
// naive method (this project's own left out, or what others do) and the daemon's default. A method breaks at
// the first value at which what is judged is above the limit, or no number; modes of energy go on to the last
// value, so that what holds beyond is known. Of mode `stiffness` and of the grasps the last sound value is
// kept instead, for what is displayed beyond it cannot be said. Analytic bounds are for a sampled spring wall
// K on a device of damping b, force held for T, delayed by t_d:
//   K ≤ b / (T/2 + t_d)                (Colgate and Schenkel 1997, passivity, hand excluded)
//   K ≤ 2 f_c / Δ                      (Abbott and Okamura 2005, quantum Δ, Coulomb friction f_c)
// They are sufficient for any passive hand; the hand here damps too, so a loop may last beyond them.
// Most modes press the ball of config/scenes/cube (stability_bench.h). Everything is deterministic.
// Units in names, SI otherwise.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/scene/scene.h"
#include "tools/chart/shard.h"
#include "tools/stability/bench/largest_stiffness.h"
#include "tools/stability/random_hands.h"
#include "tools/stability/stability_carve.h"

namespace hapticd {

// Displayed stiffness on one device, in one hand.
struct StiffnessPoint {
  std::string hand, source;  // of a grasp; empty in the map over the device's damping
  double mass = 0, damping = 0, stiffness = 0;
  double device_damping = 0;  // [N·s/m]
  Largest wall, ours, held;
  Largest alike;       // the wall with the tissue's own viscosity, 2 ms, where `wall` picks its best
  Largest controlled;  // ours with the passivity controller
  double colgate = 0;  // 2 b/T
};

// One of two hands in one body, or of one alone there; what a wall displays to it beside it. A body that
// moves away is no wall: how it sways and what it makes is looked at, at the tissue's own scale.
struct TwoHandsPoint {
  std::string body, other;  // what the other does
  int hand = 1;
  Largest ours, wall;          // along a guide, as the wall, whose viscosity is the best for it
  Largest alike;               // a wall as viscous as the tissue
  Largest free;                // ours without the guide; zero: not measured
  bool moves_away = false;     // then, in place of the above:
  double swing = 0, made = 0;  // of all starts, beyond two quanta [m]; energy [J]
};

// A link between the daemon's halves, with the tank (haptic/passivity.h) and without: what a hand at random
// makes, and the largest sound displayed stiffness.
struct LinkPoint {
  LinkTrouble link;
  RandomReport tanked, bare;
  Largest displayed, displayed_bare;
};

// A trainee's hand beside the simulation, a mentor's at an edge over a link, in one tissue: what both ends
// together make.
struct MentorPoint {
  LinkTrouble link;
  bool ghost = false;  // each hand has one of the other
  RandomReport tanked, bare;
};

struct StabilityChart {
  ShardLedger shard;                // a unit is a mode
  std::vector<StiffnessPoint> map;  // over the device's damping
  std::vector<StiffnessPoint> grasps;
  std::vector<StabilityMode> modes;
  std::vector<RandomReport> random;
  std::vector<CarveReport> carve;
  std::vector<TwoHandsPoint> two_hands;
  std::vector<RandomReport> random_two;  // two hands, then the first of them alone
  std::vector<RandomReport> random_cuts;
  std::vector<LinkPoint> links;
  std::vector<MentorPoint> mentors;
};

struct StabilitySettings {
  bool quick = false;
  std::vector<std::string> only;  // modes by name; empty: all
  std::int64_t random_ticks = 0;  // of the modes at random; 0: 10⁶, quick 2000 to 20 000
  Shard shard;                    // modes of this part alone
  std::uint64_t random_seed = 1;  // … of its first episode; each further one has the next
  double late_steps = 0;          // of those (random_hands.h)
};

std::vector<std::string> stability_mode_names();

// One thread for each core. `progress(fraction, what)`, called by the caller's, returns false to stop.
StabilityChart chart_stability(const Scene& cube, const StabilitySettings& settings,
                               const std::function<bool(double, const std::string&)>& progress);

}  // namespace hapticd
