#include "tools/client/recording.h"

#include <algorithm>
#include <stdexcept>

namespace hapticd {

Trajectory centred(const Trajectory& recording) {
  std::vector<TrajectorySample> samples = recording.samples;
  Vec3 mean = Vec3::Zero();
  for (const TrajectorySample& s : samples) mean += s.pose.p / static_cast<double>(samples.size());
  for (TrajectorySample& s : samples) s.pose.p -= mean;
  return make_trajectory(std::move(samples));
}

Trajectory scaled(const Trajectory& recording, double scale) {
  if (!(scale > 0)) throw std::invalid_argument("the scale must be positive");
  std::vector<TrajectorySample> samples = recording.samples;
  for (TrajectorySample& s : samples) s.pose.p *= scale;
  return make_trajectory(std::move(samples));
}

Trajectory from_scene(const DeviceSettings& device, const Trajectory& recording) {
  if (!(device.position_scale > 0))
    throw std::invalid_argument("the device's position scale must be positive");
  std::vector<TrajectorySample> samples = recording.samples;
  for (TrajectorySample& s : samples) {
    s.pose.p = device.frame.conjugate() * (s.pose.p - device.origin) / device.position_scale;
    s.pose.q = (device.frame.conjugate() * s.pose.q * device.tool.conjugate()).normalized();
  }
  return make_trajectory(std::move(samples));
}

double largest_speed(const Trajectory& recording) {
  double speed = 0;
  for (std::size_t i = 1; i < recording.samples.size(); ++i) {
    const TrajectorySample &a = recording.samples[i - 1], &b = recording.samples[i];
    speed = std::max(speed, (b.pose.p - a.pose.p).norm() / (b.t - a.t));
  }
  return speed;
}

}  // namespace hapticd
