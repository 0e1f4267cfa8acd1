// Rings when a time has come, from a thread of its own, so that who waits on something else sets no timer.
//
//   set(t₁), set(t₂), …, t rising:   ring() once at each t that was not moved on before it came
//
// A timer set and cancelled around each wait is two writes to the core's timer register: in a virtual machine
// each is an exit to the host of 5 to 10 µs, and both are in an answer's way. The alarm's thread sleeps until
// the time that it knows, looks whether that was moved on meanwhile, and sleeps again: `set` is one store.
// After a ring it looks again a period later: times are to be at least that far apart. Errors: the
// constructor throws std::system_error when no thread can be made. Thread safety: `set` by one thread; `ring`
// runs on the alarm's. Guarantee: `set` is wait-free.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <thread>

namespace hapticd {

class WakeupTimer {
 public:
  // on_thread runs on the new thread first: the place for priority and affinity.
  WakeupTimer(std::int64_t period_ns, std::function<void()> ring, std::function<void()> on_thread = {});
  ~WakeupTimer();  // within a period
  WakeupTimer(const WakeupTimer&) = delete;
  WakeupTimer& operator=(const WakeupTimer&) = delete;

  void set(std::int64_t time_ns) noexcept {
    due_ns_.store(time_ns, std::memory_order_relaxed);
  }  // CLOCK_MONOTONIC

 private:
  void run(const std::function<void()>& ring) noexcept;

  const std::int64_t period_ns_;
  std::atomic<std::int64_t> due_ns_{0};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace hapticd
