#include "tools/chart/step/chart_tick.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "haptic/loop.h"
#include "server/scene/scene_world.h"
#include "server/schedule/virtual_daemon.h"
#include "tools/chart/step/travelling_tip.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

constexpr double tick = 1e-3;  // [s]
constexpr int warm_up = 10;    // steps

int median(std::vector<double> values) { return static_cast<int>(quantiles(std::move(values)).p50); }

}  // namespace

const char* name_of(ContactPart part) noexcept {
  constexpr const char* names[] = {"rest", "rows", "delassus", "solve"};
  return names[static_cast<std::size_t>(part)];
}

TickFigures chart_tick(const TickSettings& settings, const std::function<bool(double)>& progress) {
  Scene scene = lens_under_tip("1k", settings.alarm_distance, settings.sample_spacing);
  scene.compliance = ComplianceMethod::exact;
  constexpr double none = 1e9;
  DeviceSettings& device = scene.first().device;
  device.max_force = device.max_torque = device.max_force_rate = device.max_speed = none;
  const TravellingTip tip(scene, {});
  PartTimes times(monotonic_ns);
  HapticOptions options = haptic_options(scene);
  options.contact.times = &times;
  options.ticks_ahead = std::numeric_limits<double>::infinity();
  VirtualDaemon daemon(make_world(scene), scene.rate, device, options);
  TickFigures figures;
  std::vector<double> us, nodes, contacts, active;
  HapticInput input;
  input.device[0].presence.connected = true;
  input.device[0].sample.enable = true;
  input.device[0].taken = true;
  const int per_step = static_cast<int>(std::lround(1 / (scene.rate * tick)));
  const int ticks = (warm_up + settings.steps) * per_step;
  for (int i = 0; i < ticks; ++i) {
    input.now_ns = 1'000'000'000 + std::int64_t{1'000'000} * i;
    input.device[0].presence.new_client = i == 0;
    ++input.device[0].sample.sequence;
    input.device[0].sample.received_ns = input.device[0].sample.client_time_ns = input.now_ns;
    input.device[0].sample.pose = to_device(device, tip.at(tick * i));
    daemon.advance(input.now_ns);
    times.start();
    const std::int64_t begin = monotonic_ns();
    const ForceSample answer = daemon.tick(input)[0];
    const std::int64_t spent = monotonic_ns() - begin;
    times.enter(0);
    if (i % per_step == 0 && !progress(static_cast<double>(i) / ticks)) break;
    if (i < warm_up * per_step) continue;
    us.push_back(1e-3 * static_cast<double>(spent));
    nodes.push_back(daemon.haptic().problem()->nodes);
    contacts.push_back(answer.contacts);
    active.push_back(answer.active);
    figures.capped += (answer.status & status_solver_cap) != 0;
    for (std::size_t p = 0; p < figures.parts_us.size(); ++p)
      figures.parts_us[p] += 1e-3 * static_cast<double>(times.ns(static_cast<ContactPart>(p)));
  }
  figures.ticks = static_cast<int>(us.size());
  for (double& part : figures.parts_us) part /= std::max(1, figures.ticks);
  for (const double t : us) figures.us_mean += t / figures.ticks;
  const Quantiles q = quantiles(std::move(us));
  figures.us_median = q.p50;
  figures.us_p99 = q.p99;
  figures.us_max = q.max;
  figures.patch_nodes = median(std::move(nodes));
  figures.contacts = median(std::move(contacts));
  figures.active = median(std::move(active));
  return figures;
}

}  // namespace hapticd
