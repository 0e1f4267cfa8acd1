#include "server/log.h"

#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdio>
#include <ctime>

namespace hapticd {
namespace {

constexpr std::array<const char*, 4> level_names = {"debug", "info", "warning", "error"};

std::atomic<LogFormat> format_now{LogFormat::human};
std::atomic<LogLevel> level_now{LogLevel::info};
std::atomic<std::uint64_t> refused{0};
thread_local bool may_log = true;

std::string iso8601(std::int64_t ns) {
  const std::time_t seconds = ns / 1'000'000'000;
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char date[32], text[40];
  std::strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%S", &parts);
  std::snprintf(text, sizeof text, "%s.%03dZ", date, static_cast<int>(ns / 1'000'000 % 1000));
  return text;
}

}  // namespace

const char* to_string(LogLevel level) noexcept { return level_names[static_cast<std::size_t>(level)]; }

std::optional<LogLevel> log_level(const std::string& name) {
  for (std::size_t i = 0; i < level_names.size(); ++i)
    if (name == level_names[i]) return static_cast<LogLevel>(i);
  return std::nullopt;
}

std::string log_line(LogFormat format, LogLevel level, std::int64_t time_ns, const std::string& event,
                     const std::string& message, const LogFields& fields) {
  if (format == LogFormat::human) return "hapticd: " + message;
  LogFields line = {
      {"time", iso8601(time_ns)}, {"level", to_string(level)}, {"event", event}, {"message", message}};
  line.update(fields);
  // A file's name may be anything; a line is UTF-8.
  return line.dump(-1, ' ', false, LogFields::error_handler_t::replace);
}

void set_log_format(LogFormat format) noexcept { format_now.store(format, std::memory_order_relaxed); }
void set_log_level(LogLevel level) noexcept { level_now.store(level, std::memory_order_relaxed); }
LogLevel log_level_now() noexcept { return level_now.load(std::memory_order_relaxed); }

void log(LogLevel level, const std::string& event, const std::string& message,
         const LogFields& fields) noexcept {
  if (!may_log) {
    refused.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  if (level < log_level_now()) return;
  try {
    timespec t{};
    clock_gettime(CLOCK_REALTIME, &t);
    const std::int64_t now = std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
    const std::string line =
        log_line(format_now.load(std::memory_order_relaxed), level, now, event, message, fields) + '\n';
    [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, line.data(), line.size());
  } catch (...) {
  }
}

void no_log_from_this_thread() noexcept { may_log = false; }
std::uint64_t lines_refused() noexcept { return refused.load(std::memory_order_relaxed); }

}  // namespace hapticd
