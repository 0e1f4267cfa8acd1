// What a mode of the atlas is: a value to be made worse, two methods, and what is judged.
//
// `run` functions are pure: a value in, a trial out.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/stability/bench/closed_loop.h"

namespace hapticd {

using ModeProgress = std::function<bool(double)>;  // of the mode, 0 to 1; false: stop

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

// One mode, tried.
struct StabilityMode {
  std::string mode;
  StabilityPlan plan;
  double naive_breaks_at = 0, default_breaks_at = 0;  // 0: never in the range
  bool survives = false;   // sound beyond what is required, or broken into a safe state that is said
  bool ends_safe = false;  // where it broke, it said so: a status bit, or words
  std::uint32_t default_status = 0;  // bits at the value that broke it, or at the largest
  std::string default_says;
  struct Point {
    double value = 0;
    StabilityTrial naive, ours;
    bool has_naive = false, has_ours = false;
  };
  std::vector<Point> points;
};

}  // namespace hapticd
