// A hand whose target a viewer moves with the mouse: a simulated device, for demonstrations. Nobody feels
// anything.
//
// One viewer at a time has it; it is given back by {"hand": {"active": false}}, by leaving, or by two seconds
// of silence (a page that is hidden). While it is held a DeviceClient (client.h) is a device as any other,
// with the hand of hand_model.h between the target and the pose: mass, damping, a spring. Texts understood:
//   {"hand": {"active": true, "target": [x, y, z], "buttons": 1}}    target: device frame [m]
// Whatever is asked for, the target stays within the device's workspace and moves at most `hand_speed`. Said:
//   hand   JSON: device (its id), viewer (0: nobody), state (off, arming, holding, failed), target, failure
// Thread safety: one thread; the client has its own. Errors: none but in what it says.
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "physics/types.h"
#include "server/dds/dds.h"
#include "tools/view/outbox.h"

namespace hapticd {

inline constexpr double hand_speed = 0.15;  // [m/s], device frame

// The next target on the way to the one that is wanted: within the sphere, no farther than speed · dt. A wish
// that is not finite is none.
Vec3 bounded_target(const Vec3& now, const Vec3& wanted, double radius, double dt) noexcept;

class RemoteHand {
 public:
  RemoteHand(const Participant& participant, std::uint32_t device_id);
  ~RemoteHand();

  void hear(std::uint64_t viewer, const std::string& text);
  // health: of the device, for its limits; null: not known yet. Null: nothing new to say.
  SharedMessage poll(const nlohmann::json* health);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace hapticd
