#include "server/os/wakeup_timer.h"

#include <algorithm>

#include "haptic/clock.h"

namespace hapticd {

WakeupTimer::WakeupTimer(std::int64_t period_ns, std::function<void()> ring, std::function<void()> on_thread)
    : period_ns_(period_ns), thread_([this, ring = std::move(ring), on_thread = std::move(on_thread)] {
        if (on_thread) on_thread();
        run(ring);
      }) {}

WakeupTimer::~WakeupTimer() {
  stopping_.store(true, std::memory_order_relaxed);
  thread_.join();
}

void WakeupTimer::run(const std::function<void()>& ring) noexcept {
  std::int64_t rung = 0;
  while (!stopping_.load(std::memory_order_relaxed)) {
    const std::int64_t due = due_ns_.load(std::memory_order_relaxed), now = monotonic_ns();
    if (due <= rung) {
      sleep_until(std::max(rung + period_ns_, now + period_ns_ / 4));
    } else if (now < due) {
      sleep_until(std::min(due, now + 2 * period_ns_));  // and look whether to end
    } else {
      rung = due;
      ring();
    }
  }
}

}  // namespace hapticd
