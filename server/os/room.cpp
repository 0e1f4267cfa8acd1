#include "server/os/room.h"

#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <latch>
#include <limits>
#include <stdexcept>
#include <vector>

namespace hapticd {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t unlimited = std::numeric_limits<std::int64_t>::max();

std::int64_t in_megabytes(std::int64_t bytes) { return bytes / 1'000'000; }

std::runtime_error too_few(int there, int needed, const std::string& what, const std::string& remedy) {
  return std::runtime_error("not enough " + what + ": " + std::to_string(needed) + " more are needed, " +
                            std::to_string(there) + " are to be had (" + remedy + ")");
}

// The number in a file of one number; `otherwise` for "max" or none.
std::int64_t number_in(const fs::path& file, std::int64_t otherwise) {
  std::ifstream in(file);
  std::int64_t value = 0;
  return in >> value ? value : otherwise;
}

// The sum of these keys of a file of lines "key value".
std::int64_t sum_in(const fs::path& file, std::array<const char*, 2> keys) {
  std::ifstream in(file);
  std::int64_t sum = 0, value = 0;
  for (std::string key; in >> key >> value;)
    for (const char* k : keys)
      if (key == k) sum += value;
  return sum;
}

struct Cgroup {
  fs::path mount, path;
  bool second = false;  // version 2
};

// Where this process is in the hierarchies that may limit memory. A line is ID:CONTROLLERS:PATH.
std::vector<Cgroup> cgroups(const fs::path& root) {
  std::vector<Cgroup> all;
  std::ifstream in(root / "proc/self/cgroup");
  for (std::string line; std::getline(in, line);) {
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = "," + line.substr(first + 1, second - first - 1) + ",";
    const fs::path path = fs::path(line.substr(second + 1)).relative_path();
    if (controllers == ",,") all.push_back({root / "sys/fs/cgroup", path, true});
    if (controllers.find(",memory,") != std::string::npos)
      all.push_back({root / "sys/fs/cgroup/memory", path, false});
  }
  // In a container without a line of its own for the controller, the mounted hierarchy is its own.
  all.push_back({root / "sys/fs/cgroup/memory", "", false});
  return all;
}

void look_at(const fs::path& folder, bool second, MemoryLeft& least) {
  const fs::path limit_file = folder / (second ? "memory.max" : "memory.limit_in_bytes");
  const std::int64_t limit = number_in(limit_file, unlimited);
  // Version 1 says "no limit" as the largest number of whole pages.
  if (limit >= unlimited / 2) return;
  const std::int64_t used = number_in(folder / (second ? "memory.current" : "memory.usage_in_bytes"), 0);
  const std::int64_t files =
      second ? sum_in(folder / "memory.stat", {"inactive_file", "active_file"})
             : sum_in(folder / "memory.stat", {"total_inactive_file", "total_active_file"});
  const std::int64_t left = limit - used + files;
  if (left < least.bytes) least = {left, limit_file.string()};
}

}  // namespace

void require_threads(int needed) {
  constexpr std::size_t small_stack = 128 * 1024;
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, small_stack);
  std::latch gate(1);
  std::vector<pthread_t> made;
  for (int i = 0; i < needed; ++i) {
    pthread_t thread{};
    const auto wait = [](void* g) -> void* {
      static_cast<std::latch*>(g)->wait();
      return nullptr;
    };
    if (pthread_create(&thread, &attributes, wait, &gate) != 0) break;
    made.push_back(thread);
  }
  pthread_attr_destroy(&attributes);
  gate.count_down();
  for (const pthread_t thread : made) pthread_join(thread, nullptr);
  if (const int there = static_cast<int>(made.size()); there < needed)
    throw too_few(there, needed, "threads", "ulimit -u, or pids.max of the cgroup");
}

void require_descriptors(int needed) {
  std::vector<int> made;
  for (int i = 0; i < needed; ++i) {
    const int file = open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (file < 0) break;
    made.push_back(file);
  }
  for (const int file : made) close(file);
  if (const int there = static_cast<int>(made.size()); there < needed)
    throw too_few(there, needed, "file descriptors", "ulimit -n, or LimitNOFILE in the unit");
}

void require_address_space(std::size_t bytes) {
  void* place = mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (place == MAP_FAILED)
    throw std::runtime_error("not enough memory: " + std::to_string(bytes >> 20) +
                             " MB of address space are needed beyond what is used at the start (ulimit -v)");
  munmap(place, bytes);
}

bool may_lock_memory() {
  rlimit limit{};
  if (getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY) return true;
  constexpr int cap_ipc_lock = 14;  // lifts the limit
  std::ifstream in("/proc/self/status");
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("CapEff:"))
      return (std::stoull(line.substr(7), nullptr, 16) >> cap_ipc_lock & 1) != 0;
  return false;
}

MemoryLeft memory_left(const fs::path& root) {
  MemoryLeft least{unlimited, {}};
  std::ifstream in(root / "proc/meminfo");
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("MemAvailable:")) least = {1024 * std::atoll(line.c_str() + 13), "MemAvailable"};
  for (const Cgroup& group : cgroups(root))
    // From the group up to the hierarchy's own folder, which in a container is the container's.
    for (fs::path path = group.path;; path = path.parent_path()) {
      look_at(path.empty() ? group.mount : group.mount / path, group.second, least);
      if (path.empty()) break;
    }
  return least;
}

void require_memory(std::int64_t bytes, const std::string& remedy) {
  const MemoryLeft left = memory_left();
  if (left.bytes >= bytes) return;
  throw std::runtime_error("not enough memory: " + std::to_string(in_megabytes(bytes)) + " MB are needed, " +
                           std::to_string(std::max<std::int64_t>(0, in_megabytes(left.bytes))) +
                           " MB are left (" + left.limit + ")" + remedy);
}

}  // namespace hapticd
