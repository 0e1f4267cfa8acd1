#include "server/plan/felt.h"

#include <algorithm>

#include "server/files/format.h"

namespace hapticd {
namespace {

constexpr double first_touch = 0.01;  // of the peak
constexpr double explained = 0.5;     // of the force's variance, by the depth
constexpr double least_felt = 0.02;   // [N]: what a hand notices at a stylus

}  // namespace

Felt felt_along(const PilotStroke& stroke, const TrialRun& run, int every_ms) {
  Felt felt;
  Vec3 n = Vec3::Zero();
  for (const Vec3& f : run.force)
    if (f.norm() > felt.peak) {
      felt.peak = f.norm();
      n = f.normalized();
    }
  if (!(felt.peak > 0)) return {};
  double count = 0, depth = 0, force = 0, depth_depth = 0, depth_force = 0, force_force = 0;
  for (std::size_t i = 0; i < run.force.size(); ++i) {
    if (run.force[i].norm() < first_touch * felt.peak) continue;
    const std::size_t k = std::min(i * static_cast<std::size_t>(every_ms), stroke.pose.size() - 1);
    const double d = -n.dot(stroke.pose[k].p - stroke.pose.front().p), g = n.dot(run.force[i]);
    ++count;
    depth += d;
    force += g;
    depth_depth += d * d;
    depth_force += d * g;
    force_force += g * g;
  }
  const double cov = depth_force - depth * force / count, var = depth_depth - depth * depth / count,
               of_force = force_force - force * force / count;
  if (cov > 0 && cov * cov >= explained * var * of_force) felt.stiffness = cov / var;
  return felt;
}

std::string describe(const Felt& felt, const SceneInstrument& held) {
  if (!(felt.peak > 0)) return "tissue     the stroke touches nothing\n";
  const DeviceSettings& d = held.device;
  const double peak = felt.peak * d.force_scale;
  const double stiffness = felt.stiffness.value_or(0) * d.position_scale * d.force_scale;
  std::string text =
      format("tissue     felt along the stroke: at most %.3g N (in the scene %.3g N)", peak, felt.peak);
  if (felt.stiffness)
    text += format(", %.3g N/m into it (in the scene %.3g N/m)", stiffness, *felt.stiffness);
  return text + (peak > d.max_force ? ": MORE than the device's max_force, which cuts it off\n"
                 : stiffness > held.device_stiffness ? ": STIFFER than the device displays stably\n"
                 : peak < least_felt                 ? ": hardly to be felt; raise mapping.force_scale\n"
                                                     : "\n");
}

}  // namespace hapticd
