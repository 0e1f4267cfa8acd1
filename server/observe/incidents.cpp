#include "server/observe/incidents.h"

#include "haptic/device.h"

namespace hapticd {
namespace {

constexpr std::int64_t seldom_ns = 10'000'000'000;

struct Watched {
  std::uint64_t LoopCounters::*count;
  const char* event;
  const char* what;
};
constexpr std::array<Watched, 9> watched = {
    {{&LoopCounters::deadline_misses, "deadline_misses", "haptic ticks ended after their deadline"},
     {&LoopCounters::missed, "slots_missed", "haptic slots were missed"},
     {&LoopCounters::refused, "states_rejected", "device states were rejected"},
     {&LoopCounters::conflicts, "conflicts", "times a second client wrote for this device: not rendered"},
     {&LoopCounters::solver_caps, "solver_caps", "contact solves ended at their cap or deadline"},
     {&LoopCounters::contacts_dropped, "contacts_dropped",
      "haptic ticks had more contacts, or more tissue within reach, than fits: the farthest was left out"},
     {&LoopCounters::overruns, "sim_overruns", "simulation steps were left out"},
     {&LoopCounters::references_failed, "references_failed", "bases failed"},
     {&LoopCounters::recording_dropped, "recording_dropped", "ticks are missing in the recording"}}};

std::string of_device(std::uint32_t id) { return "device " + std::to_string(id) + ": "; }

}  // namespace

std::vector<Incident> Incidents::look(std::int64_t now_ns, const LoopCounters& counters) {
  const std::uint32_t id = counters.device_id;
  Device& d = devices_[id];
  std::vector<Incident> out;
  const auto say = [&](LogLevel level, const char* event, const std::string& message) {
    out.push_back({level, event, of_device(id) + message, {{"device", id}}});
  };
  const std::uint32_t rose = counters.status & ~d.last.status, fell = ~counters.status & d.last.status;
  if (fell & status_disarmed) say(LogLevel::info, "armed", "armed");
  if (rose & status_disarmed && counters.silent)
    say(LogLevel::warning, "disarmed",
        "disarmed: no state of its client came for 100 ms (it or its machine stands still, its keys ended, "
        "or "
        "its network lost them); it is armed again when its client lets go (enable false) and asks");
  else if (rose & status_disarmed)
    say(LogLevel::info, "disarmed", "disarmed");
  if (rose & status_rival)
    say(LogLevel::error, "second_daemon",
        "conflict: another daemon, or somebody who plays one, writes this device's forces; neither serves "
        "it: stop "
        "one of the two, or give it another domain or device id");
  if (rose & status_latched)
    say(LogLevel::warning, "latched",
        "latched: no force until its client lets go (enable false) and asks again; three states in a row "
        "were "
        "refused (a number that does not rise, a jump, a quaternion that is not unit, NaN), or a force was "
        "not finite, or a second daemon was heard");
  if (rose & status_not_finite) say(LogLevel::error, "not_finite", "a force was not finite");
  for (std::size_t i = 0; i < watched.size(); ++i) {
    Kind& kind = d.kinds[i];
    const std::uint64_t now = counters.*watched[i].count;
    if (now < kind.said) kind.said = 0;  // another simulation counts anew
    if (now <= kind.said || (kind.ever && now_ns - kind.said_ns < seldom_ns)) continue;
    const std::uint64_t more = now - kind.said;
    say(LogLevel::warning, watched[i].event, std::to_string(more) + " " + watched[i].what);
    out.back().fields["count"] = more;
    out.back().fields["total"] = now;
    kind = {now, now_ns, true};
  }
  d.last = counters;
  return out;
}

}  // namespace hapticd
