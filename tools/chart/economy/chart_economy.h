// What a scene's plan is worth: every model that the scene allows, run along the whole of its trajectory.
//
//   error   √(mean ‖f − f_ref‖²) / max ‖f_ref‖,  f at 1 kHz from offline_run.h, f_ref its reference at 1 ms,
//           of the scene's whole model; and the jumps at swaps that the whole model does not have
//           (model_trial.h)
//   cost    CPU ms per simulation step: it, its haptic ticks and bases; the lesser of two runs
//
// The models: for each body that deforms within reach corotational, linear, linear and static (where it is
// held and never cut), rigid (where it is held and never cut); friction on and off where there is any;
// contact renewed and frozen. The plan is made as if each millisecond counted (PlanOptions::idle_share 0):
// these scenes are so small that a daemon's own plan saves little. A plan is right if its error is within the
// scene's accuracy and its cost within a fifth of the cheapest model's whose error is. Errors: InputError of
// a scene without a trajectory.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/plan/plan.h"

namespace hapticd {

struct EconomyModel {
  std::string label;  // "pad linear static, contact renewed"
  double error = 0;
  double jump = 0;  // at swaps, over the peak
  double cost_ms = 0;
  int inverted = 0;
};

struct EconomyScene {
  std::string scene;
  double accuracy = 0;
  Plan plan;
  EconomyModel chosen, cheapest, whole;  // cheapest: of those within the accuracy; empty label: none is
  std::vector<EconomyModel> models;
  double reference_change = 0;  // of a reference with half its step, over the peak

  bool within_accuracy() const { return chosen.error <= accuracy; }
  double over_cheapest() const { return cheapest.cost_ms > 0 ? chosen.cost_ms / cheapest.cost_ms : 0; }
};

// False ends it; what there is comes back.
using EconomyProgress = std::function<bool(double fraction, const std::string& what)>;

// all: every model; otherwise the plan's and the whole one alone.
EconomyScene measure_economy(const Scene& scene, bool all, const EconomyProgress& progress = {});

}  // namespace hapticd
