#include "server/dds/dds_sockets.h"

#include <dlfcn.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <regex>
#include <stdexcept>

#include "server/dds/call_table.h"
#include "server/dds/rtps_check.h"
#include "server/dds/rtps_numbers.h"

namespace hapticd {
namespace {

using Bind = int (*)(int, const sockaddr*, socklen_t) noexcept;
using Receive = ssize_t (*)(int, msghdr*, int);

thread_local bool to_loopback = false;
std::atomic<std::uint64_t> refused{0};
RtpsNumbers numbers;

std::int64_t now_ns() noexcept {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// What comes after ours; where libddsc's table was written over, what was there.
std::atomic<Bind> bind_before{nullptr};
std::atomic<Receive> recvmsg_before{nullptr};

template <typename F>
F as_function(void* found) noexcept {
  F function;
  std::memcpy(&function, &found, sizeof function);
  return function;
}
// The function that the next library has under this name.
template <typename F>
F next(const char* name) noexcept {
  void* found = dlsym(RTLD_NEXT, name);
  if (!found) std::abort();
  return as_function<F>(found);
}
Bind next_bind() noexcept {
  static const Bind function = next<Bind>("bind");
  const Bind before = bind_before.load(std::memory_order_relaxed);
  return before ? before : function;
}
Receive next_recvmsg() noexcept {
  static const Receive function = next<Receive>("recvmsg");
  const Receive before = recvmsg_before.load(std::memory_order_relaxed);
  return before ? before : function;
}

bool is_datagram(int socket) noexcept {
  int type = 0;
  socklen_t size = sizeof type;
  return getsockopt(socket, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_DGRAM;
}

void come_first();

}  // namespace

bool names_loopback_alone(const std::string& xml) {
  const std::string plain = std::regex_replace(xml, std::regex("<!--[^]*?-->"), "");
  const std::regex interface("<(NetworkInterface|NetworkInterfaceAddress)\\b[^>]*>"),
      loopback("(name|address)\\s*=\\s*[\"'](lo|127\\.[0-9.]+)[\"']");
  bool any = false;
  for (std::sregex_iterator i(plain.begin(), plain.end(), interface), end; i != end; ++i) {
    if (!std::regex_search(i->str(), loopback)) return false;
    any = true;
  }
  return any;
}

LoopbackSockets::LoopbackSockets(bool wanted) {
  next_recvmsg();  // looked up before a real-time thread receives
  static std::once_flag once;
  std::call_once(once, come_first);
  to_loopback = wanted;
}
LoopbackSockets::~LoopbackSockets() { to_loopback = false; }

std::uint64_t packets_refused() noexcept { return refused.load(std::memory_order_relaxed); }

}  // namespace hapticd

namespace hapticd {
namespace {

// In a program both functions below are before libc's for every library; in a shared library that hides them
// (tools/client_library) for none.
template <typename F>
void come_first(const char* name, F* ours, std::atomic<F*>& before) {
  void* const us = reinterpret_cast<void*>(ours);
  if (dlsym(RTLD_DEFAULT, name) == us) return;
  void* const there = redirect_calls("libddsc.so", name, us);
  if (!there)
    throw std::runtime_error(std::string("DDS: what libddsc hears cannot be checked: it has no call of ") +
                             name + " that could be led here");
  before.store(as_function<F*>(there), std::memory_order_relaxed);
}
void come_first() {
  come_first("bind", &::bind, bind_before);
  come_first("recvmsg", &::recvmsg, recvmsg_before);
}

}  // namespace
}  // namespace hapticd

extern "C" int bind(int socket, const sockaddr* address, socklen_t size) noexcept {
  using namespace hapticd;
  sockaddr_in inside{};
  if (!to_loopback || !address || size < sizeof inside || address->sa_family != AF_INET)
    return next_bind()(socket, address, size);
  std::memcpy(&inside, address, sizeof inside);
  if (inside.sin_addr.s_addr == htonl(INADDR_ANY) && is_datagram(socket))
    inside.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return next_bind()(socket, reinterpret_cast<const sockaddr*>(&inside), sizeof inside);
}

extern "C" ssize_t recvmsg(int socket, msghdr* message, int flags) {
  using namespace hapticd;
  const ssize_t received = next_recvmsg()(socket, message, flags);
  if (received < 4 || !message || message->msg_iovlen != 1) return received;
  // Longer than the buffer, it is cut: Cyclone sees that by itself.
  auto* const begin = static_cast<std::uint8_t*>(message->msg_iov[0].iov_base);
  const auto size = std::min(static_cast<std::size_t>(received), message->msg_iov[0].iov_len);
  if (size < 4 || std::memcmp(begin, "RTPS", 4) != 0) return received;
  if (rtps_is_safe({begin, size}) && numbers.take({begin, size}, now_ns())) return received;
  refused.fetch_add(1, std::memory_order_relaxed);
  constexpr std::size_t header_alone = 20;
  if (size < header_alone) return received;
  begin[4] = 2;  // a version that Cyclone takes
  begin[5] = 1;
  return header_alone;
}
