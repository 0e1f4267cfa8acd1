#include "server/dds/dds_sockets.h"

#include <dlfcn.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <regex>

#include "server/dds/rtps_check.h"

namespace hapticd {
namespace {

using Bind = int (*)(int, const sockaddr*, socklen_t);
using Receive = ssize_t (*)(int, msghdr*, int);

thread_local bool to_loopback = false;
std::atomic<std::uint64_t> refused{0};

// The function that the next library has under this name.
template <typename F>
F next(const char* name) noexcept {
  void* found = dlsym(RTLD_NEXT, name);
  if (!found) std::abort();
  F function;
  std::memcpy(&function, &found, sizeof function);
  return function;
}
Bind next_bind() noexcept {
  static const Bind function = next<Bind>("bind");
  return function;
}
Receive next_recvmsg() noexcept {
  static const Receive function = next<Receive>("recvmsg");
  return function;
}

bool is_datagram(int socket) noexcept {
  int type = 0;
  socklen_t size = sizeof type;
  return getsockopt(socket, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_DGRAM;
}

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

LoopbackSockets::LoopbackSockets(bool wanted) noexcept {
  next_recvmsg();  // looked up before a real-time thread receives
  to_loopback = wanted;
}
LoopbackSockets::~LoopbackSockets() { to_loopback = false; }

std::uint64_t packets_refused() noexcept { return refused.load(std::memory_order_relaxed); }

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
  if (size < 4 || std::memcmp(begin, "RTPS", 4) != 0 || rtps_is_safe({begin, size})) return received;
  refused.fetch_add(1, std::memory_order_relaxed);
  constexpr std::size_t header_alone = 20;
  if (size < header_alone) return received;
  begin[4] = 2;  // a version that Cyclone takes
  begin[5] = 1;
  return header_alone;
}
