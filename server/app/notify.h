// What a service manager is told, and when its watchdog may believe that all is well.
//
//   READY=1 · RELOADING=1 … READY=1 · STOPPING=1 · WATCHDOG=1 · STATUS=text
//
// as datagrams to the socket that NOTIFY_SOCKET names (sd_notify(3), without its library). Without the
// variable everything here does nothing.
//
//   ping  ⇔  half of WATCHDOG_USEC has passed, and every loop's count is another than at the last ping
//
// Thread safety: one thread. Errors: none; a manager that does not listen is not waited for.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace hapticd {

class Notifier {
 public:
  // Reads NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID, and takes them out of the environment: they are not
  // for children.
  Notifier();
  ~Notifier();
  Notifier(const Notifier&) = delete;
  Notifier& operator=(const Notifier&) = delete;

  void ready(const std::string& status) const noexcept;
  void reloading(std::int64_t monotonic_ns) const noexcept;  // `ready` ends it
  void stopping() const noexcept;
  void ping() const noexcept;

  std::int64_t watchdog_ns() const noexcept { return watchdog_ns_; }  // 0: no watchdog

 private:
  void send(const std::string& message) const noexcept;

  int socket_ = -1;
  std::string address_;  // a path, or a name in the abstract space after a zero byte
  std::int64_t watchdog_ns_ = 0;
};

// How far every loop has come; all that is asked of a loop is that its count changes.
using LoopCounts = std::vector<std::uint64_t>;

// Pure: whether a ping is due, given the loops' counts. The first look only remembers.
class WatchdogPings {
 public:
  explicit WatchdogPings(std::int64_t watchdog_ns) noexcept : every_ns_(watchdog_ns / 2) {}
  bool due(std::int64_t now_ns, const LoopCounts& counts);

 private:
  std::int64_t every_ns_;
  std::int64_t last_ns_ = 0;
  LoopCounts last_;
};

}  // namespace hapticd
