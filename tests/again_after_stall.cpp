// again_after_stall PROGRAM [ARGUMENT…]: runs a test of processes, and once more, twice at most, where it
// failed and the machine itself stood still meanwhile for as long as a client may be silent (10 ms): what it
// heard then was the machine. Each run's words stay, and tools/test prints them.
//
// It watches where HAPTICD_WATCH_STALLS is set; else it is PROGRAM. Where SCHED_FIFO is refused no stall is
// seen. The exit code is the last run's; of a signal 128 + its number.
#include <csignal>
#include <cstdio>
#include <cstdlib>

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tools/client/stall_watch.h"

namespace {

constexpr int most_runs = 3;
constexpr std::int64_t longest_ns = 10'000'000;

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
    hapticd::StallWatch watch;
    const int code = run(argv + 1);
    const hapticd::WatchedMachine machine = watch.stop();
    if (code == 0 || n == most_runs || machine.stalls.longest_ns() < longest_ns) return code;
    std::printf("\nagain_after_stall: failed (%d), the machine stood still for %.1f ms: run again\n\n", code,
                1e-6 * static_cast<double>(machine.stalls.longest_ns()));
    std::fflush(stdout);
  }
}
