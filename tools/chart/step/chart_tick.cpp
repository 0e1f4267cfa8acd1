#include "tools/chart/step/chart_tick.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <vector>

#include "haptic/haptic_step.h"
#include "haptic/loop.h"
#include "server/scene/scene_world.h"
#include "tools/chart/step/travelling_tip.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

constexpr double period = 0.02;         // [s]
constexpr double publish_after = 0.01;  // of a step's begin [s]
constexpr double tick = 1e-3;           // [s]
constexpr int warm_up = 10;             // steps

// The inverse of to_scene.
Pose on_device(const DeviceSettings& d, const Pose& X) {
  return {d.frame.conjugate() * ((X.p - d.origin) / d.position_scale),
          (d.frame.conjugate() * X.q * d.tool.conjugate()).normalized()};
}

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
  scene.device.max_force = scene.device.max_torque = scene.device.max_force_rate = scene.device.max_speed =
      none;
  const TravellingTip tip(scene, {});
  const std::unique_ptr<World> world = make_world(scene);
  const auto problem = std::make_unique<CondensedProblem>();
  world->step([] { return InstrumentSample{}; }, *problem);

  PartTimes times(monotonic_ns);
  HapticOptions options = haptic_options(scene);
  options.contact.times = &times;
  options.ticks_ahead = std::numeric_limits<double>::infinity();
  const auto state = std::make_unique<HapticState>();
  TickFigures figures;
  std::vector<double> us, nodes, contacts, active;
  HapticInput input;
  input.presence.connected = true;
  input.sample.enable = true;
  input.taken = true;
  for (int k = 0; k < warm_up + settings.steps; ++k) {
    bool latched = false;
    world->step(
        [&] {
          InstrumentSample sample;
          sample.present = true;
          sample.pose = tip.at(period * k + (latched ? tick : 0));
          latched = true;
          return sample;
        },
        *problem);
    for (int i = 0; i < static_cast<int>(period / tick); ++i) {
      const double t = period * k + publish_after + tick * i;
      input.now_ns = 1'000'000'000 + static_cast<std::int64_t>(1e9 * t);
      if (i == 0) problem->published_ns = input.now_ns;
      input.presence.new_client = input.sample.sequence == 0;
      ++input.sample.sequence;
      input.sample.received_ns = input.sample.client_time_ns = input.now_ns;
      input.sample.pose = on_device(scene.device, tip.at(t));
      times.start();
      const std::int64_t begin = monotonic_ns();
      const ForceSample answer =
          haptic_step(problem.get(), world->instrument(), scene.device, options, input, *state);
      const std::int64_t spent = monotonic_ns() - begin;
      times.enter(0);
      if (k < warm_up) continue;
      us.push_back(1e-3 * static_cast<double>(spent));
      nodes.push_back(problem->nodes);
      contacts.push_back(answer.contacts);
      active.push_back(answer.active);
      figures.capped += (answer.status & status_solver_cap) != 0;
      for (std::size_t p = 0; p < figures.parts_us.size(); ++p)
        figures.parts_us[p] += 1e-3 * static_cast<double>(times.ns(static_cast<ContactPart>(p)));
    }
    if (!progress(static_cast<double>(k + 1) / (warm_up + settings.steps))) break;
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
