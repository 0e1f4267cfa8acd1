#include "server/observe/metrics_server.h"

#include <charconv>
#include <stdexcept>
#include <utility>

#include "server/os/host_name.h"
#include "server/os/http_server.h"

namespace hapticd {
namespace {

namespace http = boost::beast::http;
using boost::asio::ip::tcp;

constexpr HttpServer::Limits limits{
    .connections = 16, .patience = std::chrono::seconds(5), .header = 8192, .body = 8192};

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

tcp::endpoint endpoint_of(const std::string& text) {
  const auto refuse = [&](const std::string& why) {
    throw std::invalid_argument("--metrics " + text + ": " + why);
  };
  auto [host, port_text] = parts_of(text);
  if (host == "localhost") host = "127.0.0.1";
  unsigned port = 0;
  const auto [end, error] = std::from_chars(port_text.data(), port_text.data() + port_text.size(), port);
  if (error != std::errc() || end != port_text.data() + port_text.size() || port > 65535 || port_text.empty())
    refuse("expected PORT, 127.0.0.1:PORT or [::1]:PORT");
  boost::system::error_code e;
  const auto address = boost::asio::ip::make_address(host, e);
  if (e) refuse("'" + host + "' is not an address: expected PORT, 127.0.0.1:PORT or [::1]:PORT");
  if (!address.is_loopback()) refuse("not a loopback address: metrics are for this machine alone");
  return {address, static_cast<std::uint16_t>(port)};
}

std::optional<HttpServer::Response> answer(const HttpServer::Request& request,
                                           const std::function<std::string()>& page) {
  const boost::string_view host = request[http::field::host];
  if (!host.empty() && !is_loopback_host({host.data(), host.size()}))  // HTTP/1.0 has none
    return http_text(http::status::forbidden, "Ask by a loopback name.\n");
  if (request.method() != http::verb::get && request.method() != http::verb::head)
    return http_text(http::status::method_not_allowed, "GET alone.\n");
  if (request.target() != "/metrics") return http_text(http::status::not_found, "Here is /metrics alone.\n");
  return http_text(http::status::ok, page(), "text/plain; version=0.0.4; charset=utf-8");
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

MetricsServer::MetricsServer(const std::string& address, std::function<std::string()> page) {
  const tcp::endpoint endpoint = endpoint_of(address);
  const auto handle = [page = std::move(page)](const HttpServer::Request& r) { return answer(r, page); };
  try {
    http_ = std::make_unique<HttpServer>(endpoint, limits, HttpServer::Handlers{handle}, "metrics");
  } catch (const boost::system::system_error& e) {
    throw std::runtime_error("--metrics " + address + ": cannot listen there: " + e.code().message());
  }
}

MetricsServer::~MetricsServer() = default;

std::uint16_t MetricsServer::port() const noexcept { return http_->port(); }

}  // namespace hapticd
