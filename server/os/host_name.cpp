#include "server/os/host_name.h"

#include <arpa/inet.h>

#include <cctype>
#include <string>

namespace hapticd {
namespace {

// Without the port, in small letters.
std::string name_of(std::string_view host) {
  const bool v6 = host.starts_with('[');
  const std::size_t end = v6 ? host.find(']') : host.find(':');
  std::string name(host.substr(0, v6 && end != std::string_view::npos ? end + 1 : end));
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return name;
}

}  // namespace

bool is_loopback_host(std::string_view host) {
  const std::string name = name_of(host);
  in_addr v4{};
  return name == "localhost" || name == "[::1]" ||
         (inet_pton(AF_INET, name.c_str(), &v4) == 1 && ntohl(v4.s_addr) >> 24 == 127);
}

bool is_address_host(std::string_view host) {
  if (is_loopback_host(host)) return true;
  const std::string name = name_of(host);
  in_addr v4{};
  in6_addr v6{};
  if (name.starts_with('['))
    return name.ends_with(']') && inet_pton(AF_INET6, name.substr(1, name.size() - 2).c_str(), &v6) == 1;
  return inet_pton(AF_INET, name.c_str(), &v4) == 1;
}

std::string_view host_of_origin(std::string_view origin) {
  for (const std::string_view scheme : {"http://", "https://"})
    if (origin.starts_with(scheme)) return origin.substr(scheme.size());
  return {};
}

}  // namespace hapticd
