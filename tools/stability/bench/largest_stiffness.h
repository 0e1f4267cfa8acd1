// The largest stiffness that a way to render displays soundly to one hand.
//
// It is raised until it swings at rest, and until renderer and device make energy, from any of several
// starts; what is kept is the last stiffness, as displayed, before the first that does. Units: SI.
#pragma once

#include <functional>

#include "tools/stability/bench/stability_bench.h"

namespace hapticd {

// The largest displayed stiffness [N/m] by swing and by energy, of one way to render.
struct Largest {
  double steady = 0, passive = 0;
};

// Between the samples of contact, where what is displayed is stiff and so touched lightly: no more than the
// radius of the circle in which these presses touch, √(r d), 0.8 mm of a ball of 3 mm that is 0.2 mm deep. By
// the scene's own 1 mm, made for 3 mm of depth, the ball would stand on one sample or two [m].
inline constexpr double light_spacing = 0.7e-3;

inline constexpr double tissue_viscosity = 2e-3;  // of the cube, stiffness-proportional [s]

// Where presses begin. Where a surface lies between two readings of the encoder is chance that no start
// moves: the stiffest wall of a Touch-like hand is 34 to 51 kN/m by it. With `moves_encoder` the encoder's
// zero goes through a quantum from start to start, the same for whatever is compared.
struct Starts {
  int count = 16;
  bool moves_encoder = false;
};

// The press of start k.
ClosedLoopSettings begun_at(const ClosedLoopSettings& s, const Starts& starts, int k);

// Raises `value` by √2 from `from` to `to`, then by halves to `factor`, until a press of run(value, settings)
// swings, and until it makes energy: what is displayed at the last sound value, of all `starts`.
Largest largest_sound(const std::function<ClosedLoopResult(double, const ClosedLoopSettings&)>& run,
                      const ClosedLoopSettings& s, double from, double to, double factor,
                      const std::function<double(double, const ClosedLoopResult&)>& displayed,
                      const Starts& starts = {});

}  // namespace hapticd
