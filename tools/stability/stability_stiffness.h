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

using ModeProgress = std::function<bool(double)>;

// Raises `value` by √2 from `from` to `to`, then by halves to `factor`, until a press of run(value, settings) swings,
// and until it makes energy: what is displayed at the last sound value, of `starts` places where it begins.
Largest largest_sound(const std::function<ClosedLoopResult(double, const ClosedLoopSettings&)>& run,
                      const ClosedLoopSettings& s, double from, double to, double factor,
                      const std::function<double(double, const ClosedLoopResult&)>& displayed, int starts = 16);

// Adds the map (of one damping, if quick) and its mode; false: stopped.
bool chart_stiffness(StabilityBench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress);

// Adds the grasps and their mode.
bool chart_grasps(StabilityBench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress);

}  // namespace hapticd
