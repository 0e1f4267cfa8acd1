// A simulation that is a network away (server/edge): with the tank (haptic/passivity.h) and without.
//
// For each link: a hand strays over the cube, about 500 N/m displayed, so many ticks; and the largest
// stiffness that a press displays soundly. With the tank problems are felt however late they come.
#pragma once

#include "tools/stability/stability.h"

namespace hapticd {

// The same with two hands, each answered at its end (server/edge/README.md, a mentor's hand), with ghosts and
// without: the energy is that of both ends.
bool chart_mentor(StabilityBench& bench, const StabilitySettings& settings, StabilityChart& chart,
                  const ModeProgress& progress);

bool chart_link(StabilityBench& bench, const StabilitySettings& settings, StabilityChart& chart,
                const ModeProgress& progress);

}  // namespace hapticd
