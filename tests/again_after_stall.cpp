// again_after_stall PROGRAM [ARGUMENT…]: runs a test of processes, and once more, twice at most, where it
// failed and the machine itself stood still, or had other work, for as long as a client may be silent (10
// ms): what it heard then was the machine. Each run's words stay, and tools/test prints them.
//
// It watches where HAPTICD_WATCH_STALLS is set; else it is PROGRAM. Tests' clients are ordinary threads, so
// an ordinary one is watched too: it sees other work, and what SCHED_FIFO would where that is refused. The
// exit code is the last run's; of a signal 128 + its number.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tools/client/stall_watch.h"

namespace {

constexpr int most_runs = 3;
constexpr std::int64_t longest_ns = 10'000'000;

// How long an ordinary thread that wants to wake every millisecond was held up at most. From its making to
// stop() all time belongs to one wake-up or another: none is lost where the thread itself begins late, or is
// taken off its core between two waits.
class HoldUpWatch {
 public:
  std::int64_t stop() {
    stopping_ = true;
    thread_.join();
    awake();
    return longest_ns_;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds interval_{1};

  void awake() {
    const auto now = Clock::now();
    longest_ns_ =
        std::max<std::int64_t>(longest_ns_, (now - last_ - interval_) / std::chrono::nanoseconds(1));
    last_ = now;
  }
  void watch() {
    while (!stopping_) {
      std::this_thread::sleep_until(last_ + interval_);
      awake();
    }
  }

  std::atomic<bool> stopping_{false};
  std::int64_t longest_ns_ = 0;
  Clock::time_point last_ = Clock::now();
  std::thread thread_{[this] { watch(); }};  // last: it uses the others
};

int run(char** command) {
  const pid_t child = fork();
  if (child < 0) return 127;
  if (child == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    execv(command[0], command);
    std::perror(command[0]);
    _exit(127);
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  if (!std::getenv("HAPTICD_WATCH_STALLS")) {
    execv(argv[1], argv + 1);
    std::perror(argv[1]);
    return 127;
  }
  for (int n = 1;; ++n) {
    hapticd::StallWatch stalls;
    HoldUpWatch hold_ups;
    const int code = run(argv + 1);
    const std::int64_t held_up_ns = hold_ups.stop(), still_ns = stalls.stop().stalls.longest_ns();
    if (code == 0 || n == most_runs || std::max(still_ns, held_up_ns) < longest_ns) return code;
    std::printf(
        "\nagain_after_stall: failed (%d), the machine stood still for %.1f ms and an ordinary thread for "
        "%.1f ms: run again\n\n",
        code, 1e-6 * static_cast<double>(still_ns), 1e-6 * static_cast<double>(held_up_ns));
    std::fflush(stdout);
  }
}
