// Whether a device state may be rendered; every refusal has a name.
//
//   refused if a component of p or q is NaN or infinite; | ‖q‖ − 1 | > tolerance; the sequence does not rise;
//   ‖p − p_previous‖ > max_speed · max(t − t_previous, period)
//
// The previous state is the last accepted one of the same client. A state that does not ask for force is not
// tested for a jump, so that a client may start again elsewhere.
// Units: m, m/s, ns. Guarantee: wait-free, no allocation.
#pragma once

#include <algorithm>
#include <cmath>

#include "haptic/device.h"

namespace hapticd {

enum class Refusal : std::uint8_t { none, not_finite, not_unit_quaternion, sequence_not_rising, jump };

// previous: null for the first state of a client. period_ns: the shortest plausible time between states.
inline Refusal check_sample(const DeviceSettings& device, const DeviceSample& sample,
                            const DeviceSample* previous, std::int64_t period_ns,
                            double quaternion_tolerance) noexcept {
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
