// What a mode of the atlas is: a value to be made worse, two methods, and what is judged.
//
// Each plan function is one mode and says in its texts what naive is, what is asked and why. `run` functions
// are pure: a value in, a trial out. Plans may measure what they need at once (a displayed stiffness).
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/stability/closed_loop.h"

namespace hapticd {

class StabilityBench;

// One method at one value.
struct StabilityTrial {
  double judged = 0;                             // infinite: not a number came out
  std::uint32_t status = 0;                      // bits of its force messages
  std::string says;                              // what else it says of itself where it is not well
  std::string worst_of;                          // where several ways were tried: which of them was the worst
  std::optional<ClosedLoopResult> loop;          // of a closed loop
  std::vector<std::pair<double, double>> trace;  // for the picture
};

struct StabilityPlan {
  std::string parameter, naive, ours, judged, reason;  // reason: of what is required
  std::string trace_x = "time [s]", trace_y = "force on the hand [N]";
  double limit = 0, required = 0, analytic_bound = 0;  // 0: no bound
  std::vector<double> values;                          // rising
  bool last_sound = false;  // what is kept is the last sound value, not the first broken
  bool goes_on = false;     // the daemon is tried beyond the first value that breaks it
  std::function<StabilityTrial(double)> run_naive, run_ours;
};

// from, from·factor, … to.
std::vector<double> geometric(double from, double to, double factor);

// Time: stability_time.cpp.
StabilityPlan plan_delay(StabilityBench&, bool quick);
StabilityPlan plan_stall(StabilityBench&, bool quick);
StabilityPlan plan_slow_simulation(StabilityBench&, bool quick);
// The network: stability_network.cpp.
StabilityPlan plan_packet_loss(StabilityBench&, bool quick);
StabilityPlan plan_random_loss(StabilityBench&, bool quick);
StabilityPlan plan_jitter(StabilityBench&, bool quick);
StabilityPlan plan_reordering(StabilityBench&, bool quick);
// The device, and friction: stability_device.cpp.
StabilityPlan plan_quantum(StabilityBench&, bool quick);
StabilityPlan plan_friction(StabilityBench&, bool quick);
// What a new problem does to the force: stability_swap.cpp.
StabilityPlan plan_swap(StabilityBench&, bool quick);
StabilityPlan plan_removal(StabilityBench&, bool quick);
// Compliance: stability_compliance.cpp.
StabilityPlan plan_near_static(StabilityBench&, bool quick);
StabilityPlan plan_rotation(StabilityBench&, bool quick);
// Contact solvers: stability_solver.cpp.
StabilityPlan plan_conforming(StabilityBench&, bool quick);
StabilityPlan plan_duplicated(StabilityBench&, bool quick);
// Elements: stability_tissue.cpp.
StabilityPlan plan_crushing(StabilityBench&, bool quick);
StabilityPlan plan_incompressible(StabilityBench&, bool quick);
// Energy of tissue on its own: stability_energy.cpp.
StabilityPlan plan_slender(StabilityBench&, bool quick);
StabilityPlan plan_let_go(StabilityBench&, bool quick);
StabilityPlan plan_remnant(StabilityBench&, bool quick);
// The tool: stability_tool.cpp.
StabilityPlan plan_fast_stroke(StabilityBench&, bool quick);
StabilityPlan plan_wedge(StabilityBench&, bool quick);
StabilityPlan plan_stiffness_ratio(StabilityBench&, bool quick);

}  // namespace hapticd
