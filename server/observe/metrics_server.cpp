#include "server/observe/metrics_server.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>

#include <charconv>
#include <cstring>
#include <stdexcept>

#include "server/os/host_name.h"

namespace hapticd {
namespace {

struct Endpoint {
  sockaddr_in v4{};
  sockaddr_in6 v6{};
  bool is_v6 = false;
  const sockaddr* address() const {
    return is_v6 ? reinterpret_cast<const sockaddr*>(&v6) : reinterpret_cast<const sockaddr*>(&v4);
  }
};

// NAME and PORT of NAME:PORT, [NAME]:PORT, PORT.
std::pair<std::string, std::string> parts_of(const std::string& text) {
  if (text.starts_with('[')) {
    const std::size_t end = text.find("]:");
    return end == std::string::npos ? std::pair(text, std::string())
                                    : std::pair(text.substr(1, end - 1), text.substr(end + 2));
  }
  const std::size_t colon = text.rfind(':');
  return colon == std::string::npos ? std::pair(std::string("127.0.0.1"), text)
                                    : std::pair(text.substr(0, colon), text.substr(colon + 1));
}

Endpoint endpoint_of(const std::string& text) {
  const auto refuse = [&](const std::string& why) {
    throw std::invalid_argument("--metrics " + text + ": " + why);
  };
  auto [host, port_text] = parts_of(text);
  if (host == "localhost") host = "127.0.0.1";
  unsigned port = 0;
  const auto [end, error] = std::from_chars(port_text.data(), port_text.data() + port_text.size(), port);
  if (error != std::errc() || end != port_text.data() + port_text.size() || port > 65535 || port_text.empty())
    refuse("expected PORT, 127.0.0.1:PORT or [::1]:PORT");
  Endpoint e;
  if (inet_pton(AF_INET, host.c_str(), &e.v4.sin_addr) == 1) {
    if (ntohl(e.v4.sin_addr.s_addr) >> 24 != 127)
      refuse("not a loopback address: metrics are for this machine alone");
    e.v4.sin_family = AF_INET;
    e.v4.sin_port = htons(static_cast<std::uint16_t>(port));
  } else if (inet_pton(AF_INET6, host.c_str(), &e.v6.sin6_addr) == 1) {
    if (!IN6_IS_ADDR_LOOPBACK(&e.v6.sin6_addr))
      refuse("not a loopback address: metrics are for this machine alone");
    e.v6.sin6_family = AF_INET6;
    e.v6.sin6_port = htons(static_cast<std::uint16_t>(port));
    e.is_v6 = true;
  } else {
    refuse("'" + host + "' is not an address: expected PORT, 127.0.0.1:PORT or [::1]:PORT");
  }
  return e;
}

MHD_Result answer(MHD_Connection* connection, unsigned code, const std::string& text) {
  MHD_Response* response =
      MHD_create_response_from_buffer(text.size(), const_cast<char*>(text.data()), MHD_RESPMEM_MUST_COPY);
  if (!response) return MHD_NO;
  MHD_add_response_header(
      response, "Content-Type",
      code == MHD_HTTP_OK ? "text/plain; version=0.0.4; charset=utf-8" : "text/plain; charset=utf-8");
  if (code == MHD_HTTP_METHOD_NOT_ALLOWED) MHD_add_response_header(response, "Allow", "GET, HEAD");
  const MHD_Result queued = MHD_queue_response(connection, code, response);
  MHD_destroy_response(response);
  return queued;
}

}  // namespace

std::string metrics_address_fault(const std::string& address) {
  try {
    endpoint_of(address);
    return {};
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
}

struct MetricsServer::Http {
  std::function<std::string()> page;
  MHD_Daemon* daemon = nullptr;

  static MHD_Result handle(void* self, MHD_Connection* connection, const char* url, const char* method,
                           const char*, const char*, std::size_t* body, void** seen) {
    // Called first with the headers alone; an answer then closes what still would come.
    static char headers_seen;
    if (!*seen) {
      *seen = &headers_seen;
      return MHD_YES;
    }
    if (*body > 0) {
      *body = 0;
      return MHD_YES;
    }
    try {
      const char* host = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, "Host");
      if (host && !is_loopback_host(host))  // HTTP/1.0 has none
        return answer(connection, MHD_HTTP_FORBIDDEN, "Ask by a loopback name.\n");
      if (std::strcmp(method, "GET") != 0 && std::strcmp(method, "HEAD") != 0)
        return answer(connection, MHD_HTTP_METHOD_NOT_ALLOWED, "GET alone.\n");
      if (std::strcmp(url, "/metrics") != 0)
        return answer(connection, MHD_HTTP_NOT_FOUND, "Here is /metrics alone.\n");
      return answer(connection, MHD_HTTP_OK, static_cast<Http*>(self)->page());
    } catch (const std::exception&) {
      return MHD_NO;
    }
  }
};

MetricsServer::MetricsServer(const std::string& address, std::function<std::string()> page)
    : http_(std::make_unique<Http>()) {
  const Endpoint endpoint = endpoint_of(address);
  http_->page = std::move(page);
  unsigned flags = MHD_USE_AUTO | MHD_USE_INTERNAL_POLLING_THREAD;
  if (endpoint.is_v6) flags |= MHD_USE_IPv6;
  http_->daemon = MHD_start_daemon(flags, 0, nullptr, nullptr, &Http::handle, http_.get(),
                                   MHD_OPTION_SOCK_ADDR, endpoint.address(), MHD_OPTION_CONNECTION_LIMIT, 16u,
                                   MHD_OPTION_CONNECTION_TIMEOUT, 5u, MHD_OPTION_END);
  if (!http_->daemon)
    throw std::runtime_error("--metrics " + address + ": cannot listen there: " + std::strerror(errno));
}

MetricsServer::~MetricsServer() {
  if (http_->daemon) MHD_stop_daemon(http_->daemon);
}

std::uint16_t MetricsServer::port() const noexcept {
  const MHD_DaemonInfo* info = MHD_get_daemon_info(http_->daemon, MHD_DAEMON_INFO_BIND_PORT);
  return info ? info->port : 0;
}

}  // namespace hapticd
