#include "server/plan/felt.h"

#include <algorithm>
#include <cstdio>

namespace hapticd {
namespace {

constexpr double first_touch = 0.01;  // of the peak
constexpr double least_felt = 0.02;   // [N]: what a hand notices at a stylus

}  // namespace

Felt felt_along(const PilotStroke& stroke, const TrialRun& run, int every_ms) {
  Felt felt;
  std::size_t peak = 0;
  for (std::size_t i = 0; i < run.force.size(); ++i)
    if (const double f = run.force[i].norm(); f > felt.peak) {
      felt.peak = f;
      peak = i;
    }
  if (!(felt.peak > 0)) return {};
  std::size_t touch = 0;
  while (run.force[touch].norm() < first_touch * felt.peak) ++touch;
  const auto pose = [&](std::size_t i) {
    return stroke.pose[std::min(i * static_cast<std::size_t>(every_ms), stroke.pose.size() - 1)].p;
  };
  const double way = (pose(peak) - pose(touch)).norm();
  felt.stiffness = way > 0 ? felt.peak / way : 0;
  return felt;
}

std::string describe(const Felt& felt, const SceneInstrument& held) {
  if (!(felt.peak > 0)) return "tissue     the stroke touches nothing\n";
  const DeviceSettings& d = held.device;
  const double peak = felt.peak * d.force_scale,
               stiffness = felt.stiffness * d.position_scale * d.force_scale;
  char text[256];
  std::snprintf(text, sizeof text,
                "tissue     felt along the stroke: at most %.3g N, %.4g N/m on the way there (in the scene "
                "%.3g N, %.4g N/m)%s\n",
                peak, stiffness, felt.peak, felt.stiffness,
                peak > d.max_force                  ? ": MORE than the device's max_force, which cuts it off"
                : stiffness > held.device_stiffness ? ": STIFFER than the device displays stably"
                : peak < least_felt                 ? ": hardly to be felt; raise mapping.force_scale"
                                                    : "");
  return text;
}

}  // namespace hapticd
