#include "haptic/sample_check.h"

#include <algorithm>
#include <cmath>

namespace hapticd {

Refusal check_sample(const DeviceSettings& device, const DeviceSample& sample, const DeviceSample* previous,
                     std::int64_t period_ns, double quaternion_tolerance) noexcept {
  if (!sample.pose.p.allFinite() || !sample.pose.q.coeffs().allFinite()) return Refusal::not_finite;
  // Written so that an overflowing norm is refused as well.
  if (!(std::abs(sample.pose.q.norm() - 1.0) <= quaternion_tolerance)) return Refusal::not_unit_quaternion;
  if (!previous) return Refusal::none;
  if (sample.sequence <= previous->sequence) return Refusal::sequence_not_rising;
  if (!sample.enable) return Refusal::none;
  const std::int64_t dt_ns = std::max(sample.received_ns - previous->received_ns, period_ns);
  const double dt = 1e-9 * static_cast<double>(dt_ns);
  if (!((sample.pose.p - previous->pose.p).norm() <= device.max_speed * dt)) return Refusal::jump;
  return Refusal::none;
}

}  // namespace hapticd
