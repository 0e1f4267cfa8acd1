#include "server/edge/remote_hand.h"

#include <algorithm>

namespace hapticd {
namespace {

constexpr double share_of_speed = 0.9;
constexpr std::int64_t period_ns = 1'000'000;  // the shortest time that sample_check.h counts

Pose towards(const Pose& from, const Pose& to, double longest) noexcept {
  const double way = (to.p - from.p).norm();
  if (way <= longest) return to;
  const double share = longest / way;
  return {from.p + share * (to.p - from.p), from.q.slerp(share, to.q)};
}

}  // namespace

bool RemotePort::take(std::int64_t now_ns, DeviceSample& sample) noexcept {
  const InstrumentInput* in = hands_.look(instrument_, now_ns);
  const bool known = presence_.connected;
  presence_ = {};
  presence_.connected = in != nullptr;
  presence_.new_client = in != nullptr && !known;
  if (!in) return false;
  const double time = 1e-9 * static_cast<double>(std::max(now_ns - last_ns_, period_ns));
  at_ = known ? towards(at_, in->X, share_of_speed * max_speed_ * time) : in->X;
  last_ns_ = now_ns;
  sample = {};
  sample.sequence = ++number_;
  sample.received_ns = now_ns;
  sample.pose = at_;
  sample.buttons = in->buttons;
  sample.enable = true;
  return true;
}

DeviceSettings in_scene(DeviceSettings device) noexcept {
  device.max_speed *= device.position_scale;
  device.workspace_radius *= device.position_scale;
  device.damping = 0;
  device.position_scale = device.force_scale = 1;
  device.origin.setZero();
  device.frame = device.tool = Quat::Identity();
  device.pivot.reset();
  device.ghost.reset();
  return device;
}

}  // namespace hapticd
