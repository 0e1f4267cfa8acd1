#include "server/app/service.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <thread>

#include "haptic/clock.h"
#include "server/files/input_error.h"
#include "server/observe/log.h"
#include "server/plan/plan.h"

namespace hapticd {
namespace {

constexpr auto relaxed = std::memory_order_relaxed;
constexpr std::int64_t figures_every_ns = 1'000'000'000;

// The service manager hears of the daemon while its one ordinary thread is busy with another scene, as long
// as that may take.
class KeepAlive {
 public:
  explicit KeepAlive(const Notifier& notifier)
      : thread_([&notifier](const std::stop_token& stop) {
          if (notifier.watchdog_ns() <= 0) return;
          const std::int64_t every = notifier.watchdog_ns() / 8, until = monotonic_ns() + longest_ns;
          for (; !stop.stop_requested() && monotonic_ns() < until; sleep_until(monotonic_ns() + every))
            notifier.ping();
        }) {}

 private:
  static constexpr std::int64_t longest_ns = 60'000'000'000;
  std::jthread thread_;
};

LoopCounters counters_of(const WorldSession& session, int device) {
  const LoopStatistics& h = session.haptic_statistics(device);
  const SimulationStatistics& s = session.simulation_statistics();
  return {.device_id = session.device_id(device),
          .status = h.status.load(relaxed) | (h.run.load(relaxed) == 0 ? std::uint32_t{status_disarmed} : 0u),
          .silent = h.silent.load(relaxed),
          .deadline_misses = h.deadline_misses.load(relaxed),
          .missed = h.missed.load(relaxed),
          .refused = h.refused.load(relaxed),
          .conflicts = h.conflicts.load(relaxed),
          .solver_caps = h.solver_caps.load(relaxed),
          .contacts_dropped = h.contacts_dropped.load(relaxed),
          // Of the world: said once.
          .overruns = device == 0 ? s.overruns.load(relaxed) : 0,
          .references_failed = device == 0 ? s.references_failed.load(relaxed) : 0,
          .recording_dropped = session.recording_dropped(device)};
}

}  // namespace

Service::Service(Daemon& daemon, Reloader& reloader, const Notifier& notifier, const sigset_t& signals,
                 ServiceOptions options)
    : daemon_(daemon),
      reloader_(reloader),
      notifier_(notifier),
      signals_(signals),
      options_(std::move(options)),
      pings_(notifier.watchdog_ns()) {
  if (!options_.key_days) return;
  constexpr double day_s = 86400, soon_days = 30;
  keys_end_s_ = std::time(nullptr) + std::llround(day_s * *options_.key_days);
  if (*options_.key_days < soon_days)
    log(LogLevel::warning, "keys_end_soon",
        "the daemon's keys end in " + std::to_string(static_cast<int>(*options_.key_days)) +
            " days: run make_keys.sh again and restart before that");
}

LoopCounts Service::counts() const {
  LoopCounts counts;
  for (const auto& session : daemon_.sessions()) {
    counts.push_back(session->haptic_turns());
    counts.push_back(session->simulation_statistics().steps.load(relaxed));
  }
  return counts;
}

void Service::run() {
  std::int64_t slice_ns = 100'000'000;
  if (notifier_.watchdog_ns() > 0)
    slice_ns = std::clamp<std::int64_t>(notifier_.watchdog_ns() / 8, 1'000'000, slice_ns);
  const timespec slice{0, slice_ns};
  const std::int64_t end =
      options_.duration > 0 ? monotonic_ns() + std::llround(1e9 * options_.duration) : INT64_MAX;
  while (monotonic_ns() < end && !daemon_.failed()) {
    siginfo_t info{};
    const int number = sigtimedwait(&signals_, &info, &slice);
    if (number == SIGINT || number == SIGTERM) return;
    if (number == SIGUSR1 && options_.figures) options_.figures();
    // Of the kernel: the terminal that it was started from is gone. Of anybody else: read the scene again.
    if (number == SIGHUP && info.si_code == SI_KERNEL) return;
    if (number == SIGHUP) reload();
    if (options_.test_hooks) test_hook(info);
    answer_command();
    const std::int64_t now = monotonic_ns();
    if (pings_.due(now, counts())) notifier_.ping();
    look(now);
  }
}

void Service::look(std::int64_t now_ns) {
  if (keys_end_s_ && !said_keys_end_ && std::time(nullptr) >= *keys_end_s_) {
    said_keys_end_ = true;
    log(LogLevel::error, "keys_ended",
        "a certificate or the permissions of this daemon have ended: its clients are let go, and none can "
        "come. "
        "Run make_keys.sh again for new ones, and restart (haptic doctor --secure DIR says which)");
  }
  const bool figures = log_level_now() == LogLevel::debug && now_ns - figures_ns_ >= figures_every_ns;
  if (figures) figures_ns_ = now_ns;
  for (const auto& session : daemon_.sessions()) {
    if (!said_out_of_room_ && session->simulation_statistics().out_of_room.load(relaxed)) {
      said_out_of_room_ = true;
      log(LogLevel::warning, "out_of_room",
          "nothing is cut any more: a body has used up its max_new_nodes (say more in the scene)");
    }
    if (!said_beyond_near_ && session->simulation_statistics().condensed_steps.load(relaxed) > 0) {
      said_beyond_near_ = true;
      log(LogLevel::warning, "beyond_near",
          "an instrument presses tissue that is condensed: it is rigid there (a body's near region is too "
          "small, or did not follow in time)");
    }
    for (int i = 0; i < session->devices(); ++i) {
      const LoopCounters counters = counters_of(*session, i);
      for (const Incident& of : incidents_.look(now_ns, counters))
        log(of.level, of.event, of.message, of.fields);
      if (!figures) continue;
      const LoopStatistics& h = session->haptic_statistics(i);
      log(LogLevel::debug, "figures",
          "device " + std::to_string(counters.device_id) + ": " + std::to_string(h.run.load(relaxed)) +
              " ticks, " + std::to_string(h.answered.load(relaxed)) + " answers, " +
              std::to_string(session->simulation_statistics().steps.load(relaxed)) + " steps",
          {{"device", counters.device_id},
           {"ticks", h.run.load(relaxed)},
           {"answered", h.answered.load(relaxed)},
           {"steps", session->simulation_statistics().steps.load(relaxed)}});
    }
  }
}

// One a turn: who asks without end does not keep a signal from being answered.
void Service::answer_command() {
  CommandPort* port = daemon_.commands();
  if (const std::optional<AskedCommand> asked = port ? port->take() : std::nullopt) {
    const Outcome outcome = asked->command == ServerCommand::reset ? reset() : reload();
    port->reply(asked->asker, outcome.done, outcome.message);
  }
}

Service::Outcome Service::reset() {
  const KeepAlive busy(notifier_);
  try {
    const std::int64_t begun = monotonic_ns();
    daemon_.reset();
    const auto ms = (monotonic_ns() - begun) / 1'000'000;
    said_out_of_room_ = said_beyond_near_ = false;
    log(LogLevel::info, "reset", "reset: the scene from its start, after " + std::to_string(ms) + " ms",
        {{"ms", ms}});
    return {true, "the scene from its start, after " + std::to_string(ms) + " ms"};
  } catch (const std::exception& e) {
    log(LogLevel::error, "reset_failed", std::string("reset failed, nothing changed: ") + e.what());
    return {false, std::string("nothing changed: ") + e.what()};
  }
}

Service::Outcome Service::reload() {
  const KeepAlive busy(notifier_);
  notifier_.reloading(monotonic_ns());
  Outcome outcome{true, ""};
  try {
    Reload r = reloader_.read();
    if (r.scene) {
      daemon_.restart([&] { return r.scene->plans ? make_plan(*r.scene).scene : std::move(*r.scene); });
      reloader_.begun_anew();
      said_out_of_room_ = said_beyond_near_ = false;
    }
    std::size_t next = 0;  // devices in the order of the scene
    for (const auto& session : daemon_.sessions())
      for (int i = 0; i < session->devices() && next < r.tunings.size(); ++i)
        session->retune(i, r.tunings[next++]);
    set_log_level(log_level(r.log_level).value_or(LogLevel::info));
    for (const std::string& what : r.clamped)
      log(LogLevel::warning, "reload_clamped", "clamped: " + what, {{"what", what}});
    for (const std::string& what : r.not_taken)
      log(LogLevel::warning, "reload_not_taken", "not taken: " + what, {{"what", what}});
    for (const std::string& what : r.taken)
      log(LogLevel::info, "reload_taken", "taken: " + what, {{"what", what}});
    for (const std::string& what : r.anew)
      log(LogLevel::info, "reload_anew", "the simulation begins again with: " + what, {{"what", what}});
    outcome.message = "reloaded: " + std::to_string(r.taken.size()) + " taken, " +
                      std::to_string(r.clamped.size()) + " clamped, " + std::to_string(r.anew.size()) +
                      " anew, " + std::to_string(r.not_taken.size()) + " not taken";
    log(LogLevel::info, "reloaded", outcome.message,
        {{"taken", r.taken}, {"clamped", r.clamped}, {"anew", r.anew}, {"not_taken", r.not_taken}});
    for (const std::string& what : r.not_taken) outcome.message += "\nnot taken: " + what;
  } catch (const std::exception& e) {
    outcome = {false, std::string("reload failed, nothing changed: ") + e.what()};
    log(LogLevel::error, "reload_failed", outcome.message);
  }
  notifier_.ready(outcome.done ? "reloaded" : "reload failed, nothing changed");
  return outcome;
}

void Service::test_hook(const siginfo_t& info) {
  for (const auto& session : daemon_.sessions()) {
    if (info.si_signo == SIGRTMIN)
      session->simulation().hold(std::int64_t{1'000'000} * info.si_value.sival_int);
    if (info.si_signo == SIGRTMIN + 1) session->simulation().poison();
  }
}

std::string ready_text(std::uint32_t domain, bool secured) {
  return "ready, domain " + std::to_string(domain) + (secured ? ", secured" : "");
}

}  // namespace hapticd
