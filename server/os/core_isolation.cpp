#include "server/os/core_isolation.h"

#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace hapticd {
namespace {

namespace fs = std::filesystem;

// Of the kernel's include/linux/sched.h, as the ninth field of /proc/PID/stat has them.
constexpr unsigned long kernel_thread = 0x0020'0000, not_movable = 0x0400'0000;

unsigned long flags_of(pid_t thread) {
  std::ifstream in("/proc/" + std::to_string(thread) + "/stat");
  std::string line, field;
  std::getline(in, line);
  const std::size_t name_ends = line.rfind(')');  // it may hold spaces and brackets
  if (name_ends == std::string::npos) return 0;
  std::istringstream rest(line.substr(name_ends + 1));
  for (int i = 3; i < 9; ++i) rest >> field;
  unsigned long flags = 0;
  rest >> flags;
  return flags;
}

}  // namespace

std::vector<pid_t> movable_kernel_threads() {
  std::vector<pid_t> threads;
  std::error_code ended;
  for (fs::directory_iterator i("/proc", ended), end; !ended && i != end; i.increment(ended)) {
    const std::string name = i->path().filename();
    pid_t id = 0;
    const auto [last, error] = std::from_chars(name.data(), name.data() + name.size(), id);
    if (error != std::errc{} || last != name.data() + name.size()) continue;
    const unsigned long flags = flags_of(id);
    if ((flags & kernel_thread) && !(flags & not_movable)) threads.push_back(id);
  }
  return threads;
}

CoreIsolation::CoreIsolation(int core, const std::vector<pid_t>& threads)
    : grant_{"kernel threads off core " + std::to_string(core), true, {}} {
  for (const pid_t thread : threads) {
    Moved m{thread, {}, {}};
    if (sched_getaffinity(thread, sizeof m.before, &m.before) != 0 || !CPU_ISSET(core, &m.before)) continue;
    m.now = m.before;
    CPU_CLR(core, &m.now);
    if (CPU_COUNT(&m.now) == 0) continue;
    if (sched_setaffinity(thread, sizeof m.now, &m.now) == 0) {
      moved_.push_back(m);
    } else if (errno == EPERM) {
      grant_.granted = false;
      grant_.detail = std::string(std::strerror(EPERM)) +
                      "; give CAP_SYS_NICE, or boot with nohz_full= and isolcpus= for that core";
    }
  }
}

CoreIsolation::~CoreIsolation() {
  for (const Moved& m : moved_) {
    cpu_set_t found;
    if (sched_getaffinity(m.thread, sizeof found, &found) == 0 && CPU_EQUAL(&found, &m.now))
      sched_setaffinity(m.thread, sizeof m.before, &m.before);
  }
}

}  // namespace hapticd
