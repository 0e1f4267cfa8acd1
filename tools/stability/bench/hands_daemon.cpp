#include "tools/stability/bench/hands_daemon.h"

#include <cmath>

#include "server/scene/scene_world.h"

namespace hapticd {
namespace {

constexpr std::int64_t tick_ns = 1'000'000;

HapticOptions options_of(const Scene& scene, const HandsDaemonSettings& settings) {
  HapticOptions options = haptic_options(scene);
  options.passivity_control = settings.passivity_control;
  if (settings.problem_old > 0) let_problems_grow_old(options.watchdog, settings.problem_old);
  return options;
}

VirtualDaemonSettings settings_of(const HandsDaemonSettings& of) {
  VirtualDaemonSettings settings;
  settings.link = of.link;
  settings.at_simulation = of.at_simulation;
  if (of.begun)
    settings.after = [begun = of.begun](StepAction action, std::int64_t) {
      if (action == StepAction::begin) begun();
    };
  return settings;
}

}  // namespace

HandsDaemon::HandsDaemon(const Scene& scene, const HandsDaemonSettings& settings)
    : daemon_(make_world(scene), scene.rate, devices_of(scene), options_of(scene, settings),
              settings_of(settings)) {
  VirtualTiming timing = usual_timing(daemon_.world());
  timing.reference = std::llround(1e9 / scene.rate);
  daemon_.set_timing(timing);
}

EachInstrument<ForceSample> HandsDaemon::tick(const EachInstrument<const DeviceSample*>& arrived,
                                              const EachInstrument<bool>& connected) {
  HapticInput input;
  input.now_ns = VirtualDaemonSettings().first_ns + count_++ * tick_ns;
  for (int i = 0; i < max_instruments; ++i) {
    DeviceInput& device = input.device[i];
    device.presence = {
        .connected = connected[i], .new_client = connected[i] && !connected_[i], .conflict = false};
    if (!arrived[i]) continue;
    device.taken = true;
    device.sample = *arrived[i];
    device.sample.received_ns = device.sample.client_time_ns = input.now_ns;
  }
  connected_ = connected;
  return daemon_.tick(input);
}

}  // namespace hapticd
