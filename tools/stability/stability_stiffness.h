// The largest stiffness that is displayed soundly: over the device's damping, and in several hands.
//
// Four ways to render the same press: an ideal 1 kHz wall (the best it does with stiffness-proportional
// damping of 0 to 5 ms), the daemon, the daemon with its passivity controller, force held for a simulation
// step. Each is raised by a factor until it swings at rest, and until renderer and device make energy, from
// any of sixteen starts: what is kept is the last stiffness, as displayed, before the first that does. Units:
// SI.
#pragma once

#include <functional>

#include "tools/stability/stability.h"

namespace hapticd {

class StabilityBench;

// Adds the map (of one damping, if quick) and its mode; false: stopped.
bool chart_stiffness(StabilityBench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress);

// Adds the grasps and their mode.
bool chart_grasps(StabilityBench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress);

}  // namespace hapticd
