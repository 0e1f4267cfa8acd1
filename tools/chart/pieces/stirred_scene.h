// A scene whose loose pieces an instrument stirs at random, step by step, without haptic loop or clock.
//
//   the tip goes from place to place about the first body, in straight strokes of at most `speed`, starting
//   and ending at rest: p(s) = a + (b − a)(3 s² − 2 s³)
//
// Places are drawn in the box that holds the first body where the stroke begins, widened sideways by `about`,
// from `above` its top to `below` it, z up. A world is made afresh every `episode` steps. Overlap is found
// after every `look`-th step (piece_overlap.h). Deterministic but for times: a function of the settings.
// Units: m, s, N. Errors: as make_world.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "physics/simulation/world.h"
#include "server/scene/scene.h"

namespace hapticd {

struct StirSettings {
  int steps = 2000;
  int episode = 1000;
  int rest = 40;  // first steps of an episode without an instrument
  int look = 1;
  double speed = 20e-3;
  double about = 0.3e-3, above = 0.3e-3, below = 1.2e-3;
  unsigned seed = 1;
};

struct StirFigures {
  std::string name;
  int steps = 0;
  std::vector<double> step_ms;
  int joint = 0;          // steps whose solve had contacts of bodies
  int capped = 0;         // … and ended before its tolerance
  int held = 0;           // … with geometry held in the end
  int friction_held = 0;  // … and friction too
  int bounded = 0;        // … that a body's motion was held back in
  int rounds = 0;         // the most
  double overlap = 0;     // the deepest [m]
  int tunnelled = 0;      // steps that left a node deeper than a tenth of an edge
  int touches = 0;        // the most contacts in a solve
  double third_law = 0;   // |Σ forces| / Σ |forces| of the bodies on one another
};

// after: each step, if anybody wants to look.
using AfterStep = std::function<void(const World&, const CondensedProblem& published, const StepReport&)>;
StirFigures stir(const Scene& scene, const StirSettings& settings,
                 const std::function<bool(double)>& progress, const AfterStep& after = {});

}  // namespace hapticd
