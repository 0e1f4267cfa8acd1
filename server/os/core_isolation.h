// Keeps the kernel's own threads off the haptic thread's core, where they may be moved.
//
// A kernel without full preemption lets what runs inside it come to a point of its own choosing: one of its
// threads that walks memory holds up SCHED_FIFO on its core for 0.1 to 0.4 ms (haptic/MEASURED.md), whatever
// its priority. Threads bound to a core are left, as are those that may run on no other core. Where /proc
// hides the kernel's threads (a container, ProtectProc=invisible) none is moved, and none told of. A process
// that is killed leaves them where they are.
// Thread safety: start-up's. Errors: a refusal is a Grant, and leaves all as it was found.
#pragma once

#include <sched.h>
#include <sys/types.h>

#include <vector>

#include "server/os/realtime.h"

namespace hapticd {

// Of the kernel's threads, those that may be given other cores.
std::vector<pid_t> movable_kernel_threads();

// Keeps threads off a core while it lives; then each has its cores back, unless somebody gave it others.
class CoreIsolation {
 public:
  explicit CoreIsolation(int core, const std::vector<pid_t>& threads = movable_kernel_threads());
  ~CoreIsolation();
  CoreIsolation(const CoreIsolation&) = delete;
  CoreIsolation& operator=(const CoreIsolation&) = delete;
  // Granted: none of them that may run elsewhere may still run there.
  const Grant& grant() const noexcept { return grant_; }

 private:
  struct Moved {
    pid_t thread;
    cpu_set_t before, now;
  };
  std::vector<Moved> moved_;
  Grant grant_;
};

}  // namespace hapticd
