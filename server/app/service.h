// The daemon between `ready` and its end: signals, the service manager's watchdog, and what is worth a log
// line.
//
//   SIGTERM, SIGINT   end      SIGUSR1   figures to a file      SIGHUP   the scene again (reload.h);
//                                                                   of a terminal that is closed: end
//   haptic/server/command   reset, or the scene again (server/dds/command.h); answered by what came of it
//   each 0.1 s        incidents (incidents.h), keys that end; at level debug a line of figures each second
//
// Thread safety: one thread, which is not a loop's. Errors: none of its own; a reload that fails is said, and
// nothing changes.
#pragma once

#include <csignal>
#include <functional>
#include <optional>
#include <string>

#include "server/app/daemon.h"
#include "server/app/notify.h"
#include "server/app/reload.h"
#include "server/observe/incidents.h"

namespace hapticd {

struct ServiceOptions {
  double duration = 0;            // [s]; 0: until a signal
  bool test_hooks = false;        // hapticd --test-hooks
  std::function<void()> figures;  // at SIGUSR1; none: ignored
  std::optional<double> key_days = {};  // until the daemon's keys end; none: there are none
};

class Service {
 public:
  // Everything referred to must outlive the object. signals: blocked in every thread.
  Service(Daemon& daemon, Reloader& reloader, const Notifier& notifier, const sigset_t& signals,
          ServiceOptions options);

  // Until a signal ends it, `duration` is over, or the daemon failed.
  void run();

 private:
  // What came of it; throws nothing.
  struct Outcome {
    bool done;
    std::string message;
  };
  Outcome reset();
  Outcome reload();
  void answer_command();
  void look(std::int64_t now_ns);
  void test_hook(const siginfo_t& info);
  LoopCounts counts() const;

  Daemon& daemon_;
  Reloader& reloader_;
  const Notifier& notifier_;
  const sigset_t signals_;
  const ServiceOptions options_;
  Incidents incidents_;
  WatchdogPings pings_;
  std::int64_t figures_ns_ = 0;
  bool said_out_of_room_ = false, said_beyond_near_ = false, said_keys_end_ = false;
  std::optional<std::int64_t> keys_end_s_;  // of CLOCK_REALTIME
};

// "ready, domain 7, secured"
std::string ready_text(std::uint32_t domain, bool secured);

}  // namespace hapticd
