#include "tools/soak/load.h"

#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cstdint>
#include <fstream>
#include <string>
#include <thread>

#include "haptic/clock.h"

namespace hapticd {
namespace {

[[noreturn]] void burn(double share, unsigned core, pid_t owner) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != owner) _exit(0);
  signal(SIGINT, SIG_IGN);
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(core, &set);
  sched_setaffinity(0, sizeof set, &set);
  std::uint32_t random = 2463534242u + core;
  volatile double sum = 0;
  for (;;) {
    random ^= random << 13;
    random ^= random >> 17;
    random ^= random << 5;
    const double turn = 8e6 + 4e6 * (random / 4294967296.0);  // [ns]
    const std::int64_t end = monotonic_ns() + static_cast<std::int64_t>(share * turn);
    while (monotonic_ns() < end)
      for (int i = 0; i < 100; ++i) sum = sum + 1.0 / (1 + i);
    const timespec rest{0, static_cast<long>((1 - share) * turn)};
    nanosleep(&rest, nullptr);
  }
}

}  // namespace

Load::Load(double share) {
  if (share <= 0) return;
  const pid_t owner = getpid();
  for (unsigned core = 0; core < std::max(1u, std::thread::hardware_concurrency()); ++core) {
    const pid_t pid = fork();
    if (pid == 0) burn(share, core, owner);
    if (pid > 0) pids_.push_back(pid);
  }
}

Load::~Load() {
  for (const pid_t pid : pids_) {
    kill(pid, SIGKILL);
    waitpid(pid, nullptr, 0);
  }
}

CpuTimes cpu_times() {
  std::ifstream in("/proc/stat");
  std::string name;
  double user = 0, nice = 0, system = 0, idle = 0, wait = 0, irq = 0, soft = 0, steal = 0;
  in >> name >> user >> nice >> system >> idle >> wait >> irq >> soft >> steal;
  const double tick = 1.0 / static_cast<double>(sysconf(_SC_CLK_TCK));
  return {tick * (user + nice + system + irq + soft), tick * (idle + wait), tick * steal};
}

}  // namespace hapticd
