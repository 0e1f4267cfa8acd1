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

double seconds(std::int64_t now_ns) {
  return 1e-9 * static_cast<double>(now_ns - VirtualDaemonSettings().first_ns);
}

}  // namespace

VirtualDaemonSettings HandsDaemon::settings_of(const HandsDaemonSettings& of) {
  VirtualDaemonSettings settings;
  settings.link = of.link;
  settings.at_simulation = of.at_simulation;
  settings.before = [this](StepAction action, std::int64_t) {
    if (late_) late_->before(action, timing_, daemon_);
  };
  settings.after = [this, begun = of.begun, published = of.published](StepAction action, std::int64_t ns) {
    if (action == StepAction::begin && begun) begun();
    if (action == StepAction::publish && published) published();
    if (action == StepAction::publish && local_)
      local_->publish(seconds(ns), *daemon_.newest(), daemon_.schedule().report().contact);
  };
  return settings;
}

HandsDaemon::HandsDaemon(const Scene& scene, const HandsDaemonSettings& settings)
    : devices_(devices_of(scene)),
      late_(settings.late),
      daemon_(make_world(scene), scene.rate, devices_, options_of(scene, settings), settings_of(settings)) {
  if (settings.rendering != Rendering::solved)
    local_.emplace(settings.rendering, daemon_.world().instruments(), haptic_options(scene).contact,
                   1 / scene.rate);
  timing_ = usual_timing(daemon_.world());
  timing_.reference = std::llround(1e9 / scene.rate);
  daemon_.set_timing(timing_);
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
  const EachInstrument<ForceSample> answers = daemon_.tick(input);
  if (!local_) return answers;
  for (int i = 0; i < max_instruments; ++i)
    if (input.device[i].taken) newest_[i] = input.device[i].sample;
  return baseline(answers, input.now_ns);
}

EachInstrument<ForceSample> HandsDaemon::baseline(const EachInstrument<ForceSample>& of_daemon,
                                                  std::int64_t now_ns) {
  const int count = static_cast<int>(devices_.size());
  InstrumentPoses X;
  for (int i = 0; i < count; ++i) {
    X[i] = to_scene(devices_[static_cast<std::size_t>(i)], newest_[i].pose);
    X.present[i] = newest_[i].sequence > 0 && connected_[i];
  }
  const EachInstrument<Vec6> wrench = local_->wrench(seconds(now_ns), X);
  EachInstrument<ForceSample> answers;
  for (int i = 0; i < count; ++i) {
    answers[i] = baseline_answer(devices_[static_cast<std::size_t>(i)], newest_[i].pose, wrench[i]);
    answers[i].step = of_daemon[i].step;
  }
  return answers;
}

}  // namespace hapticd
