// The bench of the atlas: a hand that presses the cube scene's ball 3 mm into the middle of its top.
//
// The device's limits are lifted, so that stability is the method's and not the saturation's. The displayed
// stiffness is scaled by the device's force_scale f, which changes nothing else: f times the slope of the
// cube's own force at the depth where it is F/f, from one slow press. Units: SI.
#pragma once

#include "server/scene/scene.h"
#include "tools/stability/bench/stability_mode.h"

namespace hapticd {

inline constexpr double haptic_period = 1e-3;  // [s]
inline constexpr double swing_limit = 20e-6;   // and two quanta: more is felt as a buzz [m]
inline constexpr double made_limit = 1e-6;     // energy made: a thousandth of a press's [J]

class StabilityBench {
 public:
  explicit StabilityBench(const Scene& cube);

  const ClosedLoopSettings& press() const { return press_; }
  const Scene& scene() const { return scene_; }

  // force_scale: of the device, so the displayed stiffness.
  ClosedLoopResult daemon(double force_scale, const ClosedLoopSettings& s,
                          const DaemonRendererOptions& options = {}, double rate = 50) const;
  ClosedLoopResult held(double force_scale, const ClosedLoopSettings& s, DaemonRendererOptions options = {},
                        double rate = 50) const;
  // What a daemon of this force_scale displayed in the second hold [N/m], by least squares over what is
  // within a quarter of its force.
  double displayed(double force_scale, const ClosedLoopResult& r);
  // A wall that the press reaches as deep as it does the cube, with stiffness-proportional damping.
  ClosedLoopResult wall(double stiffness, const ClosedLoopSettings& s, double damping_time = 5e-3) const;

 private:
  Scene scene_;
  ClosedLoopSettings press_;
  std::vector<ClosedLoopTick> slow_;
};

// Of a press whose slope is displayed stiffness [m/s]. Within a step of the simulation tissue is stiffer by
// its mass than from step to step, soft tissue by a sixth: what is looked at must span many steps.
inline constexpr double slow_press = 0.1e-3;

// Slope of a slow press's force over its depth, by least squares where it is within a quarter of `force`
// [N/m]; of forces scaled by `scale`, taken out.
double slope_at(const std::vector<ClosedLoopTick>& slow, double scale, double force);

bool swings(const ClosedLoopResult& r, const HandSettings& hand);
bool makes_energy(const ClosedLoopResult& r);

// Judged by the swing at rest beyond the encoder's own two quanta [µm], or by the energy made [µJ].
StabilityTrial by_swing(ClosedLoopResult r, const HandSettings& hand);
StabilityTrial by_energy(ClosedLoopResult r);
inline constexpr double swing_limit_um = 1e6 * swing_limit, made_limit_uj = 1e6 * made_limit;

// A trial of that loop: status and trace.
StabilityTrial trial_of(double judged, ClosedLoopResult r);

}  // namespace hapticd
