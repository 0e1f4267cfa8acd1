#include "tools/client/offline_replay.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "server/os/room.h"
#include "server/scene/scene_world.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr std::int64_t first_ns = 1'000 * ms;  // of tick 0; 0 would mean "never" to the watchdog
constexpr std::int64_t state_age_ns = ms / 2;
constexpr std::int64_t slots_before_enable = 50, arming_slots = 250;

}  // namespace

bool replay_offline(const Scene& scene, const std::vector<SlotSource*>& sources, std::int64_t slots,
                    const ReplaySinks& sinks, std::optional<LateSteps> late) {
  if (std::llround(1e9 / scene.rate) < ms)
    throw std::invalid_argument("the simulation cannot be faster than the haptic loop");
  require_memory(60'000'000 + memory_of(scene), "");  // else the kernel kills without a word
  ReplayedTick now;
  const int devices = static_cast<int>(std::min(sources.size(), scene.instruments.size()));
  EachInstrument<NewestForce> newest;
  std::vector<ContactForce> contacts;
  VirtualDaemonSettings settings;
  settings.first_ns = first_ns;
  VirtualDaemon* running = nullptr;
  VirtualTiming usual;
  settings.before = [&](StepAction action, std::int64_t) {
    if (late) late->before(action, usual, *running);
  };
  settings.after = [&](StepAction action, std::int64_t) {
    if (action == StepAction::publish && sinks.step)
      sinks.step({now.slot, running->world(), running->schedule().report(), samples_of(running->told()), now,
                  contacts, static_cast<std::uint32_t>(running->world().removed())});
  };
  VirtualDaemon daemon(make_world(scene), scene.rate, devices_of(scene), haptic_options(scene), settings);
  running = &daemon;
  usual = usual_timing(daemon.world());
  Progress progress("offline");
  for (std::int64_t i = 0; i < arming_slots + slots; ++i) {
    const std::int64_t now_ns = first_ns + i * ms;
    now.slot = i - arming_slots;
    daemon.advance(now_ns);
    HapticInput input;
    input.now_ns = now_ns;
    for (int d = 0; d < devices; ++d) {
      SlotSource& source = *sources[static_cast<std::size_t>(d)];
      now.command[d] = now.slot < 0 ? source.first() : source.at(now.slot, now_ns, newest[d], i > 0);
      DeviceInput& device = input.device[d];
      device.presence = {.connected = true, .new_client = i == 0, .conflict = false};
      device.taken = true;
      device.sample.sequence = static_cast<std::uint64_t>(i + 1);
      device.sample.client_time_ns = device.sample.received_ns = now_ns - state_age_ns;
      device.sample.pose = now.command[d].pose;
      device.sample.buttons = now.command[d].buttons;
      device.sample.enable = i >= slots_before_enable;
    }
    const EachInstrument<ForceSample> force = daemon.tick(input);
    const HapticState& state = daemon.haptic().state();
    for (int d = 0; d < devices; ++d) {
      newest[d] = {force[d].force, now_ns};
      now.record[d] = {now_ns, force[d], state.device[d].watchdog.sample.pose, daemon.told()[d]};
    }
    now.removed = static_cast<std::uint32_t>(daemon.world().removed());
    contacts =
        state.solved ? contact_forces(state.scratch, state.solution.instrument) : std::vector<ContactForce>{};
    if (sinks.tick) sinks.tick(now);
    if (i % 100 == 0) {
      if (interrupted()) return false;
      progress.show(static_cast<double>(i) / static_cast<double>(arming_slots + slots),
                    std::to_string(now.removed) + " removed");
    }
  }
  return true;
}

}  // namespace hapticd
