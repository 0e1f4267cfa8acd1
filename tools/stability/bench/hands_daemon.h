// The daemon of a scene with all its devices, in virtual time, a tick each millisecond.
//
// Nothing depends on the clock: two runs agree bit for bit. Units: SI, ns in samples. Errors: as World's.
#pragma once

#include <optional>
#include <vector>

#include "server/scene/scene.h"
#include "server/schedule/late_steps.h"
#include "server/schedule/virtual_daemon.h"
#include "tools/offline/baseline_rendering.h"

namespace hapticd {

struct HandsDaemonSettings {
  bool passivity_control = false;
  std::optional<LinkTrouble> link;          // between the daemon's halves
  EachInstrument<bool> at_simulation = {};  // virtual_daemon.h
  double problem_old = 0;           // of the watchdog; a problem is lost 140 ms later; 0: as usual [s]
  std::function<void()> begun;      // called when a step has begun, after its removals and cuts …
  std::function<void()> published;  // … and when its problem is out
  std::optional<LateSteps> late;    // absent: each takes the usual time
  Rendering rendering = Rendering::solved;  // others are baselines (baseline_rendering.h)
};

class HandsDaemon {
 public:
  explicit HandsDaemon(const Scene& scene, const HandsDaemonSettings& settings = {});

  // Of each device the state that arrived since the last tick, or null; a device without a client has none.
  EachInstrument<ForceSample> tick(const EachInstrument<const DeviceSample*>& arrived,
                                   const EachInstrument<bool>& connected);

  // Of the next step, whatever tips do.
  void schedule_removal(int body, std::vector<int> tets) { daemon_.schedule_removal(body, std::move(tets)); }

  const World& world() const { return daemon_.world(); }
  const HapticState& haptic() const { return daemon_.haptic().state(); }
  const DeviceState& device(int i) const { return daemon_.device_state(i); }

 private:
  VirtualDaemonSettings settings_of(const HandsDaemonSettings& of);
  EachInstrument<ForceSample> baseline(const EachInstrument<ForceSample>& of_daemon, std::int64_t now_ns);

  const std::vector<DeviceSettings> devices_;
  std::optional<LateSteps> late_;
  VirtualTiming timing_;
  VirtualDaemon daemon_;
  std::optional<LocalModel> local_;  // of a baseline
  EachInstrument<DeviceSample> newest_;
  EachInstrument<bool> connected_;
  std::int64_t count_ = 0;
};

}  // namespace hapticd
