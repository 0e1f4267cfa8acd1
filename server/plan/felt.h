// What a hand will feel of the tissue, from the forces along a plan's stroke.
//
//   peak       max ‖f‖                     stiffness   peak / ‖x_peak − x_touch‖
//
// x_touch: where the force first was a hundredth of the peak. Of tissue and coupling together, as the hand
// meets them. Units: N and N/m in the scene; at the device times force_scale, and position_scale ·
// force_scale.
#pragma once

#include <string>

#include "server/plan/model_trial.h"

namespace hapticd {

struct Felt {
  double peak = 0;       // [N]; 0: the stroke touches nothing
  double stiffness = 0;  // [N/m]
};

// every_ms: of the run's forces.
Felt felt_along(const PilotStroke& stroke, const TrialRun& run, int every_ms);

// One line, and what of it the device cannot show.
std::string describe(const Felt& felt, const SceneInstrument& held);

}  // namespace hapticd
