// Keeps every core busy for a share of the time, at ordinary priority: one process per core, pinned, that
// computes and sleeps in turns of 10 ms ± 20 %.
//
// Gone with its owner; make it before this process has other threads. Thread safety: one thread.
#pragma once

#include <sys/types.h>

#include <vector>

namespace hapticd {

class Load {
 public:
  explicit Load(double share);  // 0 … 1; 0: none
  ~Load();
  Load(const Load&) = delete;
  Load& operator=(const Load&) = delete;

 private:
  std::vector<pid_t> pids_;
};

// Time of all cores since boot [s], from /proc/stat.
struct CpuTimes {
  double busy = 0, idle = 0, steal = 0;
};
CpuTimes cpu_times();

}  // namespace hapticd
