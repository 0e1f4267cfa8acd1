#include "server/os/realtime.h"

#include <fcntl.h>
#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <thread>

namespace hapticd {
namespace {

constexpr int gibibyte = 1 << 30;

Grant answer(std::string what, int error, const std::string& remedy) {
  if (error == 0) return {std::move(what), true, {}};
  return {std::move(what), false, std::string(std::strerror(error)) + "; " + remedy};
}

int set_fifo(int priority) noexcept {
  const sched_param param{priority};
  return pthread_setschedparam(pthread_self(), SCHED_FIFO, &param);
}

int set_cores(const std::vector<int>& cores) noexcept {
  cpu_set_t set;
  CPU_ZERO(&set);
  for (int core : cores) {
    if (core < 0 || core >= CPU_SETSIZE) return EINVAL;
    CPU_SET(core, &set);
  }
  return pthread_setaffinity_np(pthread_self(), sizeof set, &set);
}

std::vector<int> cores_of_thread() {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cores;
  if (pthread_getaffinity_np(pthread_self(), sizeof set, &set) == 0)
    for (int i = 0; i < CPU_SETSIZE; ++i)
      if (CPU_ISSET(i, &set)) cores.push_back(i);
  return cores;
}

}  // namespace

std::vector<int> process_cores() {
  const std::vector<int> cores = cores_of_thread();
  return cores.empty() ? std::vector<int>{0} : cores;
}

bool realtime_allowed(int priority) {
  int error = 0;
  std::thread([&error, priority] { error = set_fifo(priority); }).join();
  return error == 0;
}

Grant keep_malloc_pages() {
  const bool done = mallopt(M_MMAP_THRESHOLD, gibibyte) == 1 && mallopt(M_TRIM_THRESHOLD, gibibyte) == 1;
  return answer("malloc keeps its pages", done ? 0 : EINVAL, "this C library has no mallopt thresholds");
}

Grant lock_memory() {
  const int error = mlockall(MCL_CURRENT | MCL_FUTURE) == 0 ? 0 : errno;
  return answer("mlockall", error, "raise the limit: ulimit -l unlimited, LimitMEMLOCK=infinity in the unit");
}

CpuLatency::CpuLatency() {
  const std::int32_t microseconds = 0;
  file_ = open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
  int error = file_ < 0 ? errno : 0;
  if (error == 0 && write(file_, &microseconds, sizeof microseconds) != sizeof microseconds) error = errno;
  grant_ = answer("no deep idle states", error, "give write access to /dev/cpu_dma_latency");
}

CpuLatency::~CpuLatency() {
  if (file_ >= 0) close(file_);
}

Grant use_fifo(int priority) {
  return answer("SCHED_FIFO " + std::to_string(priority), set_fifo(priority),
                "give CAP_SYS_NICE, or a real-time limit: ulimit -r 90, LimitRTPRIO=90 in the unit");
}

Grant use_nice(int nice) {
  const int error = setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), nice) == 0 ? 0 : errno;
  return answer("nice " + std::to_string(nice), error,
                "give CAP_SYS_NICE, or a limit: LimitNICE=" + std::to_string(nice) +
                    " in the unit, a line '@GROUP - nice " + std::to_string(nice) +
                    "' in /etc/security/limits.d/");
}

Grant use_core(int core) {
  return answer("core " + std::to_string(core), set_cores({core}), "choose one of the process's own cores");
}

void name_thread(const char* name) noexcept { pthread_setname_np(pthread_self(), name); }

void leave_core(int core) noexcept {
  std::vector<int> cores = process_cores();
  std::erase(cores, core);
  if (!cores.empty()) set_cores(cores);
}

void stand_back() noexcept {
  constexpr int after_others = 10;
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), after_others);
  leave_core(process_cores().back());
}

void prefault_stack() noexcept {
  constexpr std::size_t bytes = 512 * 1024, page = 4096;
  volatile char touched[bytes];
  for (std::size_t i = 0; i < bytes; i += page) touched[i] = 0;
  touched[bytes - 1] = touched[0];
}

void prefault_heap(std::size_t bytes) noexcept {
  constexpr std::size_t page = 4096;
  auto* const block = static_cast<volatile char*>(std::malloc(bytes));
  if (!block) return;
  for (std::size_t i = 0; i < bytes; i += page) block[i] = 0;
  std::free(const_cast<char*>(block));
}

ScopedCore::ScopedCore(int core) : before_(cores_of_thread()), grant_(use_core(core)) {}

ScopedCore::~ScopedCore() {
  if (grant_.granted) set_cores(before_);
}

}  // namespace hapticd
