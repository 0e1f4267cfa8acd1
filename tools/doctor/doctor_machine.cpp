// The part of `haptic doctor` that is about the machine.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <thread>

#include "physics/compliance/blas_threads.h"
#include "server/os/core_isolation.h"
#include "server/os/realtime.h"
#include "tools/doctor/doctor.h"

#ifdef HAPTICD_OPENBLAS
extern "C" {
char* openblas_get_config();
}
#endif
extern "C" void dgemm_();

namespace hapticd {
namespace {

std::string first_line(const std::string& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

std::string limit_text(rlim_t limit) { return limit == RLIM_INFINITY ? "unlimited" : std::to_string(limit); }

Finding kernel() {
  utsname name{};
  uname(&name);
  const bool realtime = first_line("/sys/kernel/realtime") == "1" ||
                        std::string(name.version).find("PREEMPT_RT") != std::string::npos;
  const std::string found = std::string(name.sysname) + " " + name.release;
  if (realtime) return {"kernel", Health::pass, found + ", PREEMPT_RT", ""};
  return {"kernel", Health::warn,
          found + ", without PREEMPT_RT: wake-ups can be late by milliseconds under load",
          "apt-get install linux-image-rt-amd64, and start that kernel"};
}

Finding cores() {
  const std::vector<int> all = process_cores();
  const std::string found = std::to_string(all.size()) + " cores: haptic loop on " +
                            std::to_string(all.back()) + ", simulation on " + std::to_string(all.front());
  if (all.size() >= 2) return {"cores", Health::pass, found, ""};
  return {"cores", Health::warn, "1 core for both loops", "give it two: CPUAffinity= in the unit, taskset"};
}

// Moved as the daemon moves them, and given back at once.
Finding kernel_threads() {
  const int core = process_cores().back();
  const Grant grant = CoreIsolation(core).grant();
  if (grant.granted)
    return {"kernel threads", Health::pass, "may all be kept off core " + std::to_string(core), ""};
  return {"kernel threads", Health::warn,
          "may run on core " + std::to_string(core) + ": wake-ups can be late by half a millisecond",
          grant.detail};
}

Finding scheduling() {
  rlimit limit{};
  getrlimit(RLIMIT_RTPRIO, &limit);
  const std::string found = "RLIMIT_RTPRIO " + limit_text(limit.rlim_cur) + ", SCHED_FIFO " +
                            std::to_string(haptic_priority) + (realtime_allowed() ? " granted" : " refused");
  if (realtime_allowed()) return {"scheduling", Health::pass, found, ""};
  return {"scheduling", Health::warn, found,
          "as a service LimitRTPRIO=90 is set; else a line '@GROUP - rtprio 90' in /etc/security/limits.d/, "
          "or ulimit -r 90"};
}

// Tried on a thread that ends at once.
Finding simulation_first() {
  Grant grant;
  std::thread([&grant] { grant = use_nice(simulation_nice); }).join();
  if (grant.granted) return {"simulation first", Health::pass, grant.what + " granted", ""};
  return {"simulation first", Health::warn,
          grant.what + " refused: steps are late where other programs keep the simulation's core busy",
          grant.detail};
}

// CAP_IPC_LOCK: a limit of nothing does not bind then.
bool locks_without_limit() {
  rlimit before{};
  getrlimit(RLIMIT_MEMLOCK, &before);
  const rlimit none{0, before.rlim_max};
  if (setrlimit(RLIMIT_MEMLOCK, &none) != 0) return false;
  char byte = 0;
  const bool locked = mlock(&byte, 1) == 0;
  if (locked) munlock(&byte, 1);
  setrlimit(RLIMIT_MEMLOCK, &before);
  return locked;
}

Finding memory() {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  const bool privileged = locks_without_limit();
  // What a scene of the published size holds, with its stacks.
  constexpr rlim_t wanted = rlim_t{512} << 20;
  const bool enough = limit.rlim_cur == RLIM_INFINITY || limit.rlim_cur >= wanted || privileged;
  const std::string found =
      "RLIMIT_MEMLOCK " + limit_text(limit.rlim_cur) + (privileged ? ", CAP_IPC_LOCK" : "");
  if (enough) return {"memory lock", Health::pass, found, ""};
  return {"memory lock", Health::warn, found + " bytes: pages can be taken away in the loop",
          "as a service LimitMEMLOCK=infinity is set; else '@GROUP - memlock unlimited' in "
          "/etc/security/limits.d/"};
}

Finding clock() {
  const std::string source = first_line("/sys/devices/system/clocksource/clocksource0/current_clocksource");
  if (source.empty())
    return {"clock", Health::warn, "the clock source is not told here",
            "see /sys/devices/system/clocksource"};
  if (source == "hpet" || source == "acpi_pm" || source == "jiffies" || source == "refined-jiffies")
    return {"clock", Health::warn, source + ": each reading is a slow system call",
            "boot with clocksource=tsc tsc=reliable where the processor's TSC is invariant"};
  return {"clock", Health::pass, source, ""};
}

Finding idle() {
  constexpr const char* file = "/dev/cpu_dma_latency";
  const int opened = open(file, O_WRONLY | O_CLOEXEC);
  if (opened >= 0) {
    close(opened);
    return {"idle states", Health::pass, std::string(file) + " may be held", ""};
  }
  return {"idle states", Health::warn,
          std::string(file) + (access(file, F_OK) == 0 ? " may not be opened" : " is not there") +
              ": deep idle states delay wake-ups",
          "for a user: a udev rule like /usr/lib/udev/rules.d/60-hapticd.rules with your group"};
}

Finding governor() {
  const std::string name = first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  if (name.empty()) return {"frequency", Health::pass, "not changed by this kernel", ""};
  if (name == "performance") return {"frequency", Health::pass, name, ""};
  return {"frequency", Health::warn, "governor " + name + ": a step can begin on a slow clock",
          "cpupower frequency-set -g performance"};
}

Finding blas() {
  Dl_info info{};
  const bool known = dladdr(reinterpret_cast<void*>(&dgemm_), &info) != 0 && info.dli_fname;
  const std::string library = known ? std::filesystem::weakly_canonical(info.dli_fname).string() : "unknown";
#ifdef HAPTICD_OPENBLAS
  const int threads = blas_threads();
  const std::string found = library + ": " + openblas_get_config() + ", " + std::to_string(threads) +
                            (threads == 1 ? " thread" : " threads");
  return {"BLAS", threads == 1 ? Health::pass : Health::fail, found,
          threads == 1 ? "" : "a fault of this program: blas_threads.h"};
#else
  return {"BLAS", Health::warn, library + ": the reference BLAS; the base of a large body takes seconds",
          "build with libopenblas-dev installed"};
#endif
}

}  // namespace

std::vector<Finding> check_machine() {
  return {kernel(), cores(), kernel_threads(), scheduling(), simulation_first(),
          memory(), clock(), idle(),           governor(),   blas()};
}

}  // namespace hapticd
