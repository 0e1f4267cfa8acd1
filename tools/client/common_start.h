// One time axis for several clients of a process: it begins when the last of them is armed.
//
//   arrive   by each client once, when its device renders force in the wanted phase
//   time_ns  0 until all have arrived; then when slot 0 is due, a little ahead
//
// Each client keeps the phase that it has against the daemon, so slot 0 of each lies within half a period of
// this time. Thread safety: any thread. Guarantee: wait-free.
#pragma once

#include <atomic>
#include <cstdint>

namespace hapticd {

class CommonStart {
 public:
  explicit CommonStart(int clients) noexcept : missing_(clients) {}

  void arrive(std::int64_t now_ns) noexcept {
    if (missing_.fetch_sub(1, std::memory_order_relaxed) == 1)
      time_ns_.store(now_ns + ahead_ns, std::memory_order_relaxed);
  }
  std::int64_t time_ns() const noexcept { return time_ns_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::int64_t ahead_ns = 20'000'000;  // longer than most stalls of a client
  std::atomic<int> missing_;
  std::atomic<std::int64_t> time_ns_{0};
};

}  // namespace hapticd
