#include "tools/client/stall_watch.h"

#include <algorithm>

#include "haptic/clock.h"
#include "server/os/realtime.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

constexpr int watch_priority = 95;  // above haptic_priority and Cyclone's
static_assert(watch_priority > haptic_priority);
constexpr std::int64_t late_ns = 250'000;
constexpr std::int64_t last_core_ns = 250'000, other_cores_ns = 1'000'000;  // between two wake-ups
constexpr std::size_t most_stalls = 1 << 16;  // a core; later ones are not excused

double milliseconds(std::int64_t ns) { return 1e-6 * static_cast<double>(ns); }

}  // namespace

Stalls::Stalls(std::vector<Stall> of_all_cores) : all_(std::move(of_all_cores)) {
  std::sort(all_.begin(), all_.end(), [](const Stall& a, const Stall& b) { return a.begin_ns < b.begin_ns; });
  std::size_t n = 0;
  for (const Stall& s : all_) {
    if (n > 0 && s.begin_ns <= all_[n - 1].end_ns)
      all_[n - 1].end_ns = std::max(all_[n - 1].end_ns, s.end_ns);
    else
      all_[n++] = s;
  }
  all_.resize(n);
}

bool Stalls::strike(std::int64_t from_ns, std::int64_t to_ns) const noexcept {
  const auto after =
      std::partition_point(all_.begin(), all_.end(), [&](const Stall& s) { return s.end_ns <= from_ns; });
  return after != all_.end() && after->begin_ns < to_ns;
}

std::int64_t Stalls::total_ns() const noexcept {
  std::int64_t sum = 0;
  for (const Stall& s : all_) sum += s.end_ns - s.begin_ns;
  return sum;
}

std::int64_t Stalls::longest_ns() const noexcept {
  std::int64_t longest = 0;
  for (const Stall& s : all_) longest = std::max(longest, s.end_ns - s.begin_ns);
  return longest;
}

SlotCount between_stalls(const SlotBook& book, const Stalls& stalls, std::int64_t from_ns,
                         std::int64_t to_ns) {
  SlotCount count;
  const std::int64_t period = book.plan().period_ns;
  for (std::int64_t k = 0; k < book.scheduled(); ++k) {
    const std::int64_t t = book.plan().time_of(k);
    if (t < from_ns || t >= to_ns || stalls.strike(t - period, t + 2 * period)) continue;
    ++count.scheduled;
    count.sent += book.sent_ns(k) != 0;
    count.answered += book.answered_ns(k) != 0;
  }
  return count;
}

StallWatch::StallWatch() : watching_(realtime_allowed(watch_priority)) {
  if (!watching_) return;
  const std::vector<int> cores = process_cores();
  seen_.resize(cores.size());
  for (std::vector<Stall>& seen : seen_) seen.reserve(most_stalls);
  for (std::size_t i = 0; i < cores.size(); ++i)
    threads_.emplace_back([this, core = cores[i],
                           interval = i + 1 < cores.size() ? other_cores_ns : last_core_ns,
                           &seen = seen_[i]] { watch(core, interval, seen); });
}

StallWatch::~StallWatch() { stop(); }

void StallWatch::watch(int core, std::int64_t interval_ns, std::vector<Stall>& seen) noexcept {
  name_thread("stall-watch");
  if (!use_core(core).granted || !use_fifo(watch_priority).granted) return;
  std::int64_t due = monotonic_ns();
  while (!stopping_.load(std::memory_order_relaxed)) {
    due += interval_ns;
    sleep_until(due);
    const std::int64_t awake = monotonic_ns();
    if (awake - due <= late_ns) continue;
    if (seen.size() < most_stalls) seen.push_back({due, awake});
    due = awake;
  }
}

WatchedMachine StallWatch::stop() {
  stopping_.store(true, std::memory_order_relaxed);
  for (std::thread& t : threads_) t.join();
  threads_.clear();
  std::vector<Stall> all;
  for (const std::vector<Stall>& seen : seen_) all.insert(all.end(), seen.begin(), seen.end());
  return {watching_, Stalls(std::move(all)),
          seen_.empty() ? 0 : milliseconds(Stalls(seen_.back()).total_ns())};
}

nlohmann::ordered_json to_json(const WatchedMachine& machine) {
  return {{"watched", machine.watched},
          {"count", machine.stalls.count()},
          {"total_ms", rounded(milliseconds(machine.stalls.total_ns()), 3)},
          {"longest_ms", rounded(milliseconds(machine.stalls.longest_ns()), 3)},
          {"last_core_ms", rounded(machine.last_core_ms, 3)}};
}

std::string to_text(const WatchedMachine& machine) {
  if (!machine.watched) return "not watched: SCHED_FIFO is refused";
  if (machine.stalls.count() == 0) return "never";
  return std::to_string(machine.stalls.count()) + " times, " +
         fixed(milliseconds(machine.stalls.total_ns()), 1) + " ms in all, " +
         fixed(milliseconds(machine.stalls.longest_ns()), 1) + " ms at most";
}

}  // namespace hapticd
