// Where methods fail, and where this one does: sweeps of a closed loop (closed_loop.h) until it breaks.
//
// A mode raises one parameter by a factor from step to step, until at least what is required of it. A method
// breaks at the first value at which the hand swings, or renderer and device together make energy; of mode
// `stiffness` the last sound one is kept instead, for what is displayed beyond it cannot be said. Naive is
// what is done without this project's method, said in each mode; default is the daemon as it is. Analytic
// bounds are for a sampled spring wall K on a device of damping b, force held for T, delayed by t_d:
//   K ≤ b / (T/2 + t_d)                (Colgate and Schenkel 1997, passivity, hand excluded)
//   K ≤ 2 f_c / Δ                      (Abbott and Okamura 2005, quantum Δ, Coulomb friction f_c)
// They are sufficient for any passive hand; the hand here damps too, so a loop may last beyond them.
// Scene: config/scenes/cube, its device's limits lifted so that stability is the method's and not the
// saturation's; the displayed stiffness is scaled by the device's force_scale f, which changes nothing else:
// f times the slope of the cube's own force at the depth where it is F/f, from one slow press.
// Deterministic. Units in names, SI otherwise.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/scene.h"
#include "tools/closed_loop.h"

namespace hapticd {

struct StabilityMode {
  std::string mode, parameter, naive, reason;  // reason: of what is required
  bool by_energy = false;                      // judged by energy made, else by the swing at rest
  double naive_breaks_at = 0, default_breaks_at = 0, analytic_bound = 0;  // 0: never in the range; no bound
  double required = 0, swept_from = 0, swept_to = 0;
  bool survives = false;   // sound beyond what is required, or broken into a safe state that is said
  bool ends_safe = false;  // where it broke, the status said that force is being withdrawn
  std::uint32_t default_status = 0;  // bits at the value that broke it, or at the largest
  // Curves for the picture: the parameter, what is judged (swing [m], surplus [J]) for each method.
  struct Point {
    double value = 0;
    ClosedLoopResult naive, ours;
    bool has_naive = false, has_ours = false;
  };
  std::vector<Point> points;
};

// Displayed stiffness against device damping: one row of the map.
struct StiffnessPoint {
  double damping = 0;                                           // of the device [N·s/m]
  double wall = 0, ours = 0, held = 0;                          // largest stable [N/m]
  double wall_passive = 0, ours_passive = 0, held_passive = 0;  // … that makes no energy
  double colgate = 0;                                           // 2 b/T
};

struct StabilityChart {
  std::vector<StiffnessPoint> map;
  std::vector<StabilityMode> modes;
};

struct StabilitySettings {
  bool quick = false;
  std::vector<std::string> only;  // modes by name; empty: all
};

std::vector<std::string> stability_mode_names();

// `progress(fraction, what)` returns false to stop.
StabilityChart chart_stability(const Scene& scene, const StabilitySettings& settings,
                               const std::function<bool(double, const std::string&)>& progress);

}  // namespace hapticd
