// A hand whose device another process answers, as a haptic loop has it: a port that gives the pose as it
// arrives, and forgets the force.
//
//   there   while it was told to be, at most `hands_lost_ns` ago; one that comes back is a new client
//   pose    goes after the newest by at most 0.9 v_max (t − t_last), so that no step of the network is a jump
//
// Its device's frame is the scene (in_scene). The loop has it in its contact problem as any device's; what it
// is answered is the other process's to say. Units: SI, ns, scene. Thread safety: the loop's thread.
// Guarantee: wait-free, no allocation.
#pragma once

#include "haptic/loop.h"
#include "server/edge/edge_hands.h"

namespace hapticd {

// What the link told last. Shared by the ports of one loop.
class RemoteHands {
 public:
  explicit RemoteHands(Channel<InstrumentInputs>& told) noexcept : told_(told) {}
  // Null: not there.
  const InstrumentInput* look(int instrument, std::int64_t now_ns) noexcept {
    if (told_.acquire()) heard_ns_ = now_ns;
    const InstrumentInput& in = told_.front()[instrument];
    return in.present && now_ns - heard_ns_ < hands_lost_ns ? &in : nullptr;
  }

 private:
  Channel<InstrumentInputs>& told_;
  std::int64_t heard_ns_ = 0;
};

class RemotePort final : public DevicePort {
 public:
  // device: as the loop has it, so in_scene.
  RemotePort(RemoteHands& hands, int instrument, const DeviceSettings& device) noexcept
      : hands_(hands), instrument_(instrument), max_speed_(device.max_speed) {}

  bool take(std::int64_t now_ns, DeviceSample& sample) noexcept override;
  std::int64_t await(std::int64_t, const EachInstrument<std::int64_t>&) noexcept override { return 0; }
  Presence presence() const noexcept override { return presence_; }
  void write(const ForceSample&) noexcept override {}

 private:
  RemoteHands& hands_;
  const int instrument_;
  const double max_speed_;
  Pose at_;
  std::uint64_t number_ = 0;
  std::int64_t last_ns_ = 0;
  Presence presence_;
};

// The device of such a hand: poses are of the scene; no ghost, for its force is not rendered here.
DeviceSettings in_scene(DeviceSettings device) noexcept;

}  // namespace hapticd
