#include "server/app/notify.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>

namespace hapticd {
namespace {

// The variable's value, and the variable gone.
std::string taken_from_environment(const char* name) {
  const char* value = std::getenv(name);
  std::string text = value ? value : "";
  unsetenv(name);
  return text;
}

}  // namespace

Notifier::Notifier() {
  address_ = taken_from_environment("NOTIFY_SOCKET");
  const std::string period = taken_from_environment("WATCHDOG_USEC");
  const std::string pid = taken_from_environment("WATCHDOG_PID");
  if (address_.empty() || (address_[0] != '/' && address_[0] != '@')) return;
  if (address_.size() >= sizeof sockaddr_un{}.sun_path) return;
  if (address_[0] == '@') address_[0] = '\0';
  socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const bool for_us = pid.empty() || std::strtoll(pid.c_str(), nullptr, 10) == getpid();
  if (socket_ >= 0 && for_us) watchdog_ns_ = 1000 * std::strtoll(period.c_str(), nullptr, 10);
}

Notifier::~Notifier() {
  if (socket_ >= 0) close(socket_);
}

void Notifier::send(const std::string& message) const noexcept {
  if (socket_ < 0) return;
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::memcpy(to.sun_path, address_.data(), address_.size());
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
  sendto(socket_, message.data(), message.size(), MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&to),
         length);
}

void Notifier::ready(const std::string& status) const noexcept { send("READY=1\nSTATUS=" + status); }
void Notifier::reloading(std::int64_t ns) const noexcept {
  send("RELOADING=1\nMONOTONIC_USEC=" + std::to_string(ns / 1000));
}
void Notifier::stopping() const noexcept { send("STOPPING=1"); }
void Notifier::ping() const noexcept { send("WATCHDOG=1"); }

bool WatchdogPings::due(std::int64_t now_ns, const LoopCounts& counts) {
  if (every_ns_ <= 0) return false;
  if (last_.size() != counts.size()) {
    last_ = counts;
    last_ns_ = now_ns;
    return false;
  }
  if (now_ns - last_ns_ < every_ns_) return false;
  for (std::size_t i = 0; i < counts.size(); ++i)
    if (counts[i] == last_[i]) return false;
  last_ = counts;
  last_ns_ = now_ns;
  return true;
}

}  // namespace hapticd
