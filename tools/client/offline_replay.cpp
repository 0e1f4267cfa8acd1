#include "tools/client/offline_replay.h"

#include <cmath>
#include <stdexcept>

#include "server/scene/scene_world.h"
#include "server/schedule/virtual_daemon.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr std::int64_t first_ns = 1'000 * ms;  // of tick 0; 0 would mean "never" to the watchdog
constexpr std::int64_t state_age_ns = ms / 2;
constexpr std::int64_t slots_before_enable = 50, arming_slots = 250;

}  // namespace

bool replay_offline(const Scene& scene, SlotSource& source, std::int64_t slots, const ReplaySinks& sinks) {
  if (std::llround(1e9 / scene.rate) < ms)
    throw std::invalid_argument("the simulation cannot be faster than the haptic loop");
  ReplayedTick now;
  NewestForce newest;
  std::vector<ContactForce> contacts;
  VirtualDaemonSettings settings;
  settings.first_ns = first_ns;
  const VirtualDaemon* running = nullptr;
  settings.after = [&](StepAction action, std::int64_t) {
    if (action == StepAction::publish && sinks.step)
      sinks.step({now.slot, running->world(), running->schedule().report(), now.record.force,
                  now.record.instrument.X, contacts, static_cast<std::uint32_t>(running->world().removed())});
  };
  VirtualDaemon daemon(make_world(scene), scene.rate, scene.device, haptic_options(scene), settings);
  running = &daemon;
  Progress progress("offline");
  for (std::int64_t i = 0; i < arming_slots + slots; ++i) {
    const std::int64_t now_ns = first_ns + i * ms;
    now.slot = i - arming_slots;
    daemon.advance(now_ns);
    now.command = now.slot < 0 ? source.first() : source.at(now.slot, now_ns, newest, i > 0);

    HapticInput input;
    input.now_ns = now_ns;
    input.presence = {.connected = true, .new_client = i == 0, .conflict = false};
    input.taken = true;
    input.sample.sequence = static_cast<std::uint64_t>(i + 1);
    input.sample.client_time_ns = input.sample.received_ns = now_ns - state_age_ns;
    input.sample.pose = now.command.pose;
    input.sample.buttons = now.command.buttons;
    input.sample.enable = i >= slots_before_enable;
    const ForceSample force = daemon.tick(input);
    const HapticState& state = daemon.haptic().state();
    newest = {force.force, now_ns};
    now.record = {now_ns, force, state.watchdog.sample.pose, daemon.told()};
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
