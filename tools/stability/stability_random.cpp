#include "tools/stability/stability_random.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "tools/client/hand_model.h"
#include "tools/offline/renderer.h"
#include "tools/stability/episodes.h"
#include "tools/stability/two_hands/stray.h"

namespace hapticd {

namespace {

constexpr double tick_s = 1e-3;
constexpr int substeps = 4;

void episode(const Scene& scene, const RandomSettings& settings, std::uint64_t seed, std::int64_t ticks,
             RandomReport& report, const std::function<bool(std::int64_t)>& progress) {
  const DeviceSettings& device = scene.first().device;
  DaemonRendererOptions options;
  options.passivity_control = settings.passivity_control;
  DaemonRenderer daemon(scene, options);
  Stray stray(seed);
  HandSettings hand;
  hand.quantum = 55e-6;
  hand.saturation = device.max_force;
  HandState state;
  const auto on_device = [&](const Vec3& tip) -> Vec3 {
    return device.frame.conjugate() * ((tip - device.origin) / device.position_scale);
  };
  state.x = on_device(stray.tip());
  PassivityObserver energy;
  Vec3 before = state.x;
  std::uint32_t last = 0;
  for (std::int64_t i = 0; i < ticks; ++i) {
    const Vec3 tip = stray.tip();
    stray.advance();
    HandTarget target{on_device(tip), Vec3::Zero()};
    target.v = (on_device(stray.tip()) - target.x) / tick_s;
    DeviceSample sample;
    sample.sequence = static_cast<std::uint64_t>(i) + 1;
    sample.pose = {quantised(state.x, hand.quantum), through_incision(tip)};
    sample.buttons = stray.buttons();
    // Who has been disarmed asks again, wherever the tip is by then.
    sample.enable = i % 200 != 199 || (last & (status_disarmed | status_latched)) == 0;
    const ForceSample answer = daemon.tick(stray.lost() ? nullptr : &sample);
    ++report.ticks;
    if (!answer.force.allFinite() || !std::isfinite(answer.energy) || !state.x.allFinite()) {
      ++report.not_finite;
      return;
    }
    const double size = answer.force.norm();
    report.force_max = std::max(report.force_max, size);
    report.above_maximum += size > device.max_force * (1 + 1e-9);
    report.latched += (answer.status & status_latched) != 0;
    report.saturated += (answer.status & status_saturated) != 0;
    report.in_contact += answer.active > 0;
    report.status |= last = answer.status;
    const Vec3 control = daemon.haptic().device[0].controlled;
    report.controlled_force_max = std::max(report.controlled_force_max, control.norm());
    report.controlled_force_rms += control.squaredNorm();
    for (int k = 0; k < substeps; ++k)
      state = advanced(hand, state, {target.x + tick_s * k / substeps * target.v, target.v}, answer.force,
                       tick_s / substeps);
    energy.add(answer.force, state.x - before);
    report.controlled_work -= control.dot(state.x - before);
    before = state.x;
    if (i + 1 == ticks) report.solver_caps += answer.solver_caps;
    if (i % 256 == 0 && !progress(256)) return;
  }
  report.made = std::max(report.made, -energy.minimum);
  report.absorbed += energy.energy;
  report.removed += daemon.world().removed();
}

// What several episodes come to.
void add(const RandomReport& part, RandomReport& sum) {
  sum.ticks += part.ticks;
  sum.in_contact += part.in_contact;
  sum.not_finite += part.not_finite;
  sum.above_maximum += part.above_maximum;
  sum.latched += part.latched;
  sum.solver_caps += part.solver_caps;
  sum.saturated += part.saturated;
  sum.removed += part.removed;
  sum.force_max = std::max(sum.force_max, part.force_max);
  sum.made = std::max(sum.made, part.made);
  sum.absorbed += part.absorbed;
  sum.controlled_force_max = std::max(sum.controlled_force_max, part.controlled_force_max);
  sum.controlled_work += part.controlled_work;
  sum.controlled_force_rms += part.controlled_force_rms;
  sum.status |= part.status;
}

}  // namespace

RandomReport run_random(const Scene& cataract, const RandomSettings& settings,
                        const std::function<bool(double)>& progress) {
  const auto run = [&](std::uint64_t seed, std::int64_t ticks, RandomReport& part,
                       const std::function<bool(std::int64_t)>& done) {
    episode(cataract, settings, seed, ticks, part, done);
  };
  const std::vector<RandomReport> parts =
      run_episodes<RandomReport>(settings.ticks, settings.episode, settings.seed, run, progress);
  RandomReport report;
  report.passivity_control = settings.passivity_control;
  report.device_max = cataract.first().device.max_force;
  for (const RandomReport& part : parts) add(part, report);
  if (report.ticks > 0)
    report.controlled_force_rms = std::sqrt(report.controlled_force_rms / static_cast<double>(report.ticks));
  return report;
}

}  // namespace hapticd
