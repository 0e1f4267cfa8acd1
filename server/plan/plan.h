// The least model a scene needs: which terms are worth their cost, decided by what they cost and change here.
//
//   out of reach  the device cannot bring the instrument to it: it stands still and costs nothing
//   rigid         its softest surface node against the coupling: e ≤ c/(c + 1/K_vc), c = n·C n, C of K alone;
//                 never the last that deforms within reach
//   the rest      a cheaper choice is run along a stroke (model_trial.h), and made if it costs less and
//   leaves
//                 the whole plan's force error within four fifths of `accuracy`
//
// Choices are tried one after the other, what saves most first: elements linear, motion static, compliance
// zone, friction left out, contact frozen. What was kept has therefore been run as a whole, and the error
// estimate is that run's. What the scene pins is left; what the stroke does not press keeps its whole model
// and sleeps. Where not even the whole model meets `accuracy` nothing is made cheaper, but for the rate's
// sake. Nor is accuracy traded for time that is idle: where a step takes less than half a period, only
// choices are made that leave the error where the whole model has it.
//
// Costs: CPU ms per simulation step, its haptic ticks and bases included. Errors: RMS over peak force, of the
// stroke, with what a choice adds to the force's jumps at swaps (model_trial.h). Takes about 2 s, longer
// where a step takes long; nothing is remembered. Throws what reading the scene's trajectory
// does, and InputError where nothing that deforms is within the device's reach.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "server/plan/felt.h"
#include "server/scene/scene.h"

namespace hapticd {

struct PlanLine {
  std::string term;    // "lens: elements"
  std::string choice;  // "corotational"
  std::string reason;
  double cost_ms = 0;         // what the choice adds to a step over the cheapest that was tried
  double error_estimate = 0;  // what it adds to the error over the best that was tried
};

struct Plan {
  Scene scene;  // with the choices made; `plans` is off
  std::vector<PlanLine> lines;
  std::string stroke;
  double cost_ms = 0;  // of the whole plan
  double step_ms = 0;  // 9 of 10 simulation steps take less
  double tick_ms = 0;
  double error_estimate = 0;
  bool met = true;      // accuracy
  bool on_time = true;  // rate
  double seconds = 0;   // it took
  Felt felt;            // of the stroke, by the whole model
};

struct PlanOptions {
  double idle_share =
      0.5;  // of a period: steps that take less have time to spare; 0: each millisecond counts
};

// Of a scene without `model: auto` the same table of what is set, measured, nothing chosen.
Plan make_plan(const Scene& scene, const PlanOptions& options = {});

std::string describe(const Plan& plan);
nlohmann::ordered_json to_json(const Plan& plan);  // plan[] and the totals

}  // namespace hapticd
