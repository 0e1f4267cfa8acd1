#include "server/observe/log.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <climits>
#include <cstdio>
#include <ctime>
#include <mutex>

namespace hapticd {
namespace {

constexpr std::array<const char*, 4> level_names = {"debug", "info", "warning", "error"};

std::atomic<LogFormat> format_now{LogFormat::human};
std::atomic<LogLevel> level_now{LogLevel::info};
std::atomic<std::uint64_t> refused{0}, lost{0};
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

// stderr, such that a write never waits for whoever reads it. It may be shared with the shell that started
// the process, so its own flags stay: pipes and terminals are opened once more.
class Output {
 public:
  // Whether all of the line was written.
  bool write(const std::string& line) noexcept {
    struct stat now {};
    if (fstat(STDERR_FILENO, &now) != 0) return false;
    if (S_ISSOCK(now.st_mode))
      return whole(send(STDERR_FILENO, line.data(), line.size(), MSG_DONTWAIT | MSG_NOSIGNAL), line);
    if (!S_ISFIFO(now.st_mode) && !S_ISCHR(now.st_mode))
      return whole(::write(STDERR_FILENO, line.data(), line.size()), line);
    if (now.st_dev != device_ || now.st_ino != inode_ || own_ < 0) {
      if (own_ >= 0) close(own_);
      own_ = open("/proc/self/fd/2", O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
      device_ = now.st_dev;
      inode_ = now.st_ino;
      cut_ = false;
    }
    if (own_ < 0) {  // somebody else's terminal
      pollfd room{STDERR_FILENO, POLLOUT, 0};
      return line.size() <= PIPE_BUF && poll(&room, 1, 0) == 1 && (room.revents & POLLOUT) &&
             whole(::write(STDERR_FILENO, line.data(), line.size()), line);
    }
    // After a line that was cut the next one begins anew.
    const std::string text = (cut_ ? "\n" : "") + line;
    const ssize_t n = ::write(own_, text.data(), text.size());
    if (n > 0) cut_ = n < static_cast<ssize_t>(text.size());
    return whole(n, text);
  }

 private:
  static bool whole(ssize_t n, const std::string& line) noexcept {
    return n == static_cast<ssize_t>(line.size());
  }
  int own_ = -1;
  dev_t device_ = 0;
  ino_t inode_ = 0;
  bool cut_ = false;
};

std::mutex output_lock;  // held for writes that do not wait
Output output;
std::uint64_t lost_and_told = 0;

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
    const LogFormat format = format_now.load(std::memory_order_relaxed);
    const std::string line = log_line(format, level, now, event, message, fields) + '\n';
    const std::lock_guard lock(output_lock);
    if (!output.write(line)) {
      lost.fetch_add(1, std::memory_order_relaxed);
      return;
    }
    const std::uint64_t missing = lost.load(std::memory_order_relaxed) - lost_and_told;
    if (missing == 0) return;
    const std::string told =
        log_line(format, LogLevel::warning, now, "lines_lost",
                 std::to_string(missing) + " lines were lost: nobody read them", {{"count", missing}}) +
        '\n';
    if (output.write(told)) lost_and_told += missing;
  } catch (...) {
  }
}

void no_log_from_this_thread() noexcept { may_log = false; }
std::uint64_t lines_lost() noexcept { return lost.load(std::memory_order_relaxed); }
std::uint64_t lines_refused() noexcept { return refused.load(std::memory_order_relaxed); }

}  // namespace hapticd
