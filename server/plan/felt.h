// What a hand will feel of the tissue, from the forces along a plan's stroke.
//
//   peak       max ‖f‖                     stiffness   cov(d, g) / var(d)
//
// d = −n·x and g = n·f, with n the direction of the largest force, over the samples that touch: what a
// millimetre more of depth adds. Nothing where the depth explains less than half of how the force varies (a
// stroke along the surface, tissue that goes meanwhile). Of tissue and coupling together, as the hand meets
// them. Units: N and N/m in the scene; at the device times force_scale, and position_scale · force_scale.
#pragma once

#include <optional>
#include <string>

#include "server/plan/model_trial.h"

namespace hapticd {

struct Felt {
  double peak = 0;                  // [N]; 0: the stroke touches nothing
  std::optional<double> stiffness;  // [N/m]
};

// every_ms: of the run's forces.
Felt felt_along(const PilotStroke& stroke, const TrialRun& run, int every_ms);

// One line, and what of it the device cannot show.
std::string describe(const Felt& felt, const SceneInstrument& held);

}  // namespace hapticd
