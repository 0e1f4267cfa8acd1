#include "tools/chart/step/chart_tick.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <vector>

#include "haptic/clock.h"
#include "server/scene/scene_world.h"
#include "server/schedule/virtual_daemon.h"
#include "tools/chart/step/travelling_tip.h"
#include "tools/cli/report.h"
#include "tools/offline/offline_parts.h"

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
  scene.instruments.resize(static_cast<std::size_t>(settings.hands), scene.first());
  std::vector<TravellingTip> tips;
  for (std::size_t i = 0; i < scene.instruments.size(); ++i) {
    DeviceSettings& device = scene.instruments[i].device;
    device.id = static_cast<std::uint32_t>(i);
    device.max_force = device.max_torque = device.max_force_rate = device.max_speed = none;
    TipSettings tip;
    if (settings.hands > 1) {
      tip.around = 1.6e-3;
      tip.aside = 0.4e-3;
      tip.turned = 2 * std::numbers::pi * static_cast<double>(i) / settings.hands;
    }
    tips.emplace_back(scene, tip);
  }
  PartTimes times(monotonic_ns);
  HapticOptions options = haptic_options(scene);
  options.contact.times = &times;
  options.ticks_ahead = std::numeric_limits<double>::infinity();
  VirtualDaemon daemon(make_world(scene), scene.rate, devices_of(scene), options);
  TickFigures figures;
  figures.hands = settings.hands;
  std::vector<double> us, cpu_us, nodes, contacts, least, active;
  HapticInput input;
  const int per_step = static_cast<int>(std::lround(1 / (scene.rate * tick)));
  const int ticks = (warm_up + settings.steps) * per_step;
  for (int i = 0; i < ticks; ++i) {
    input.now_ns = 1'000'000'000 + std::int64_t{1'000'000} * i;
    for (int k = 0; k < settings.hands; ++k) {
      DeviceInput& hand = input.device[k];
      hand.presence = {.connected = true, .new_client = i == 0, .conflict = false};
      hand.taken = hand.sample.enable = true;
      ++hand.sample.sequence;
      hand.sample.received_ns = hand.sample.client_time_ns = input.now_ns;
      const auto at = static_cast<std::size_t>(k);
      hand.sample.pose = to_device(scene.instruments[at].device, tips[at].at(tick * i));
    }
    daemon.advance(input.now_ns);
    const double cpu_begin = offline::cpu_seconds();
    times.start();
    const std::int64_t begin = monotonic_ns();
    const EachInstrument<ForceSample> answer = daemon.tick(input);
    times.enter(0);
    const std::int64_t spent = monotonic_ns() - begin;
    const double cpu = offline::cpu_seconds() - cpu_begin;
    if (i % per_step == 0 && !progress(static_cast<double>(i) / ticks)) break;
    if (i < warm_up * per_step) continue;
    us.push_back(1e-3 * static_cast<double>(spent));
    nodes.push_back(daemon.haptic().problem()->nodes);
    cpu_us.push_back(1e6 * cpu);
    double all = 0, fewest = std::numeric_limits<double>::infinity(), pressing = 0;
    for (int k = 0; k < settings.hands; ++k) {
      all += answer[k].contacts;
      pressing += answer[k].active;
      fewest = std::min<double>(fewest, answer[k].contacts);
    }
    contacts.push_back(all);
    least.push_back(fewest);
    active.push_back(pressing);
    figures.capped += (answer[0].status & status_solver_cap) != 0;
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
  const Quantiles cpu = quantiles(std::move(cpu_us));
  figures.cpu_us_median = cpu.p50;
  figures.cpu_us_p99 = cpu.p99;
  figures.patch_nodes = median(std::move(nodes));
  figures.contacts = median(std::move(contacts));
  figures.least_contacts = median(std::move(least));
  figures.active = median(std::move(active));
  return figures;
}

}  // namespace hapticd
