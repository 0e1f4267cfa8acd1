#include "tools/client/hand_source.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace hapticd {

HandSource::HandSource(const HandSettings& hand, HandScript script, int substeps)
    : hand_(hand), script_(std::move(script)), substeps_(substeps), delay_(hand.delay) {
  check(hand);
  if (substeps < 1) throw std::invalid_argument("a slot needs one substep at least");
  state_.x = script_.target(0).x;
}

DeviceCommand HandSource::measured() const noexcept {
  DeviceCommand command = script_.command(1e-3 * static_cast<double>(reached_));
  command.pose.p = quantised(state_.x, hand_.quantum);
  return command;
}

DeviceCommand HandSource::at(std::int64_t k, std::int64_t now_ns, const NewestForce& newest,
                             bool fresh) noexcept {
  if (zero_ns_ == 0) zero_ns_ = now_ns - k * 1'000'000;
  if (fresh) delay_.push(newest.arrived_ns, newest.force);
  while (reached_ < k) advance_one_slot(zero_ns_ + reached_ * 1'000'000);
  return measured();
}

void HandSource::advance_one_slot(std::int64_t slot_ns) noexcept {
  const double h = 1e-3 / substeps_;
  for (int i = 0; i < substeps_; ++i) {
    const double part = static_cast<double>(i) / substeps_;
    const Vec3 force =
        saturated(delay_.at(slot_ns + static_cast<std::int64_t>(1e6 * part)), hand_.saturation);
    const HandTarget target = script_.target(1e-3 * (static_cast<double>(reached_) + part));
    const Vec3 before = state_.x;
    state_ = advanced(hand_, state_, target, force, h);

    const double error = (state_.x - target.x).norm();
    figures_.passivity.add(force, state_.x - before);
    figures_.force_square_sum += force.squaredNorm();
    figures_.force_max = std::max(figures_.force_max, force.norm());
    figures_.error_square_sum += error * error;
    figures_.error_max = std::max(figures_.error_max, error);
    const double t = 1e-3 * (static_cast<double>(reached_) + part);
    if (t >= script_.rest_from && t < script_.rest_to) figures_.rest.extend(state_.x);
    ++figures_.substeps;
  }
  ++reached_;
}

}  // namespace hapticd
