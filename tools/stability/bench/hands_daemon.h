// The daemon of a scene with all its devices, in virtual time, a tick each millisecond.
//
// Nothing depends on the clock: two runs agree bit for bit. Units: SI, ns in samples. Errors: as World's.
#pragma once

#include "server/scene/scene.h"
#include "server/schedule/virtual_daemon.h"

namespace hapticd {

class HandsDaemon {
 public:
  // reference_steps: from the step that asks for a reference factor to the one that adopts it. begun: called
  // when a step has begun, after its removals and cuts.
  explicit HandsDaemon(const Scene& scene, bool passivity_control = false, int reference_steps = 1,
                       const std::function<void()>& begun = {});

  // Of each device the state that arrived since the last tick, or null; a device without a client has none.
  EachInstrument<ForceSample> tick(const EachInstrument<const DeviceSample*>& arrived,
                                   const EachInstrument<bool>& connected);

  const World& world() const { return daemon_.world(); }
  const HapticState& haptic() const { return daemon_.haptic().state(); }

 private:
  VirtualDaemon daemon_;
  EachInstrument<bool> connected_;
  std::int64_t count_ = 0;
};

}  // namespace hapticd
