// When the machine itself stood still, by a bare timer thread on every core.
//
//   due at t, awake at t' > t + 250 µs            a stall [t, t')
//   a slot scheduled at s is struck by it         s − 1 ms < t' and t < s + 2 ms: its own period and one
//   either side
//
// The threads are SCHED_FIFO above every priority of ours, so nothing of ours can keep them from their core:
// what they are late by is the host's of a virtual machine, or the kernel's. It tells whose fault an
// unanswered slot is. Of a stall up to 500 µs it may see less, or nothing; of one up to 1.25 ms on a core but
// the last, which is the haptic thread's. Cost: 4 000 wake-ups a second on that one (8 % of it on a virtual
// machine), 1 000 on each other: the simulation's. Without the right to SCHED_FIFO nothing is watched, and
// nothing is excused. Units: ns, CLOCK_MONOTONIC. Errors: std::system_error when no thread can be made.
#pragma once

#include <atomic>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tools/client/slots.h"

namespace hapticd {

struct Stall {
  std::int64_t begin_ns = 0, end_ns = 0;
};

// In order, apart from one another.
class Stalls {
 public:
  Stalls() = default;
  explicit Stalls(std::vector<Stall> of_all_cores);  // in any order

  bool strike(std::int64_t from_ns, std::int64_t to_ns) const noexcept;
  std::int64_t total_ns() const noexcept;
  std::int64_t longest_ns() const noexcept;
  std::size_t count() const noexcept { return all_.size(); }

 private:
  std::vector<Stall> all_;
};

struct SlotCount {
  std::int64_t scheduled = 0, sent = 0, answered = 0;
};
// The slots from … to (by their schedule) that no stall strikes.
SlotCount between_stalls(const SlotBook& book, const Stalls& stalls, std::int64_t from_ns = INT64_MIN,
                         std::int64_t to_ns = INT64_MAX);

// What a watch has seen.
struct WatchedMachine {
  bool watched = false;
  Stalls stalls;        // of any core
  double last_core_ms;  // in all, of the one that a daemon with the same cores gives to its haptic thread
};

class StallWatch {
 public:
  StallWatch();
  ~StallWatch();
  StallWatch(const StallWatch&) = delete;
  StallWatch& operator=(const StallWatch&) = delete;

  WatchedMachine stop();  // ends the watch

 private:
  void watch(int core, std::int64_t interval_ns, std::vector<Stall>& seen) noexcept;

  bool watching_ = false;
  std::atomic<bool> stopping_{false};
  std::vector<std::vector<Stall>> seen_;  // per core
  std::vector<std::thread> threads_;
};

// {watched, count, total_ms, longest_ms, last_core_ms}
nlohmann::ordered_json to_json(const WatchedMachine& machine);
std::string to_text(const WatchedMachine& machine);

}  // namespace hapticd
