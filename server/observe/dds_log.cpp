#include "server/observe/dds_log.h"

#include <dds/ddsrt/log.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <string>

#include "server/dds/dds_sockets.h"

namespace hapticd {
namespace {

constexpr std::size_t places = 256, longest = 400;

// A place is free for the writer whose turn it is, or full for the reader's: the turn says which.
struct Place {
  std::atomic<std::uint64_t> turn{0};
  LogLevel level = LogLevel::warning;
  std::uint32_t domain = 0;
  std::uint32_t size = 0;
  std::array<char, longest> text{};
};

class Lines {
 public:
  Lines() noexcept {
    for (std::size_t i = 0; i < places; ++i) place_[i].turn.store(i, std::memory_order_relaxed);
  }
  bool push(LogLevel level, std::uint32_t domain, std::string_view text) noexcept {
    std::uint64_t turn = written_.load(std::memory_order_relaxed);
    while (true) {
      Place& place = place_[turn % places];
      const std::uint64_t now = place.turn.load(std::memory_order_acquire);
      if (now < turn) return false;  // full
      if (now > turn) {
        turn = written_.load(std::memory_order_relaxed);
        continue;
      }
      if (!written_.compare_exchange_weak(turn, turn + 1, std::memory_order_relaxed)) continue;
      place.level = level;
      place.domain = domain;
      place.size = static_cast<std::uint32_t>(std::min(text.size(), longest));
      std::memcpy(place.text.data(), text.data(), place.size);
      place.turn.store(turn + 1, std::memory_order_release);
      return true;
    }
  }
  // Calls f(level, domain, text) for the oldest; false where there is none.
  template <typename F>
  bool pop(F&& f) {
    Place& place = place_[read_ % places];
    if (place.turn.load(std::memory_order_acquire) != read_ + 1) return false;
    f(place.level, place.domain, std::string_view(place.text.data(), place.size));
    place.turn.store(read_ + places, std::memory_order_release);
    ++read_;
    return true;
  }

 private:
  std::array<Place, places> place_;
  std::atomic<std::uint64_t> written_{0};
  std::uint64_t read_ = 0;
};

// What is written in a period, and what only counted.
struct Period {
  std::int64_t begun_ns = 0;
  int written = 0;
  std::uint64_t left_out = 0, packets_said = 0;
};

Lines lines;
Period period;
std::atomic_flag busy = ATOMIC_FLAG_INIT;
std::atomic<std::uint64_t> said{0}, dropped{0};

void write(LogLevel level, std::uint32_t domain, std::string_view text) {
  LogFields fields = LogFields::object();
  if (domain <= 230) fields["domain"] = domain;  // Cyclone fills in anything before there is one
  log(level, "dds", "DDS: " + std::string(text), fields);
}

void sink(void*, const dds_log_data_t* data) {
  std::string_view text(data->message, data->size);  // its header is before it
  while (!text.empty() && (text.back() == '\n' || text.back() == '\0')) text.remove_suffix(1);
  const LogLevel level = data->priority & (DDS_LC_FATAL | DDS_LC_ERROR) ? LogLevel::error : LogLevel::warning;
  // After its last word Cyclone ends the process.
  if (data->priority & DDS_LC_FATAL)
    log(level, "dds", "DDS: " + std::string(text));
  else
    note_dds_line(level, data->domid, text);
}

void end_period(std::int64_t now_ns) {
  const std::uint64_t missing = period.left_out + dropped.exchange(0, std::memory_order_relaxed);
  if (missing > 0)
    log(LogLevel::warning, "dds", "DDS: " + std::to_string(missing) + " more lines were left out",
        {{"left_out", missing}});
  if (const std::uint64_t refused = packets_refused(); refused > period.packets_said) {
    const std::uint64_t more = refused - period.packets_said;
    log(LogLevel::warning, "packets_refused",
        std::to_string(more) +
            " packets were refused: no DDS would send them; some would end Cyclone, or make it deaf to a "
            "client",
        {{"count", more}, {"total", refused}});
    period.packets_said = refused;
  }
  period.begun_ns = now_ns;
  period.written = 0;
  period.left_out = 0;
}

}  // namespace

void take_dds_log() noexcept { dds_set_log_sink(sink, nullptr); }

void note_dds_line(LogLevel level, std::uint32_t domain, std::string_view text) noexcept {
  said.fetch_add(1, std::memory_order_relaxed);
  if (!lines.push(level, domain, text)) dropped.fetch_add(1, std::memory_order_relaxed);
}

void write_dds_log(std::int64_t now_ns) noexcept {
  if (busy.test_and_set(std::memory_order_acquire)) return;
  try {
    if (now_ns - period.begun_ns >= dds_period_ns) end_period(now_ns);
    const auto written_or_counted = [](LogLevel level, std::uint32_t domain, std::string_view text) {
      if (period.written++ < dds_lines_per_period)
        write(level, domain, text);
      else
        ++period.left_out;
    };
    // Not more than there are places: the writers may be as fast.
    for (std::size_t i = 0; i < places && lines.pop(written_or_counted); ++i) continue;
  } catch (...) {
  }
  busy.clear(std::memory_order_release);
}

void write_whole_dds_log() noexcept {
  if (busy.test_and_set(std::memory_order_acquire)) return;
  try {
    for (std::size_t i = 0; i < places && lines.pop(write); ++i) continue;
    end_period(period.begun_ns);
  } catch (...) {
  }
  busy.clear(std::memory_order_release);
}

std::uint64_t dds_lines() noexcept { return said.load(std::memory_order_relaxed); }

}  // namespace hapticd
