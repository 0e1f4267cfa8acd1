#include "server/observe/metrics_server.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <charconv>
#include <chrono>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>

#include "server/os/host_name.h"
#include "server/os/realtime.h"

namespace hapticd {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using tcp = asio::ip::tcp;
using Error = boost::system::error_code;

constexpr int most_connections = 16;
constexpr auto patience = std::chrono::seconds(5);
constexpr std::size_t largest_header = 8192, largest_body = 8192;

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
  Error e;
  const asio::ip::address address = asio::ip::make_address(host, e);
  if (e) refuse("'" + host + "' is not an address: expected PORT, 127.0.0.1:PORT or [::1]:PORT");
  if (!address.is_loopback()) refuse("not a loopback address: metrics are for this machine alone");
  return {address, static_cast<std::uint16_t>(port)};
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
  class Visit;

  std::function<std::string()> page;
  int connections = 0;
  asio::io_context io{1};  // ends before the above, which its handlers use
  tcp::acceptor acceptor{io};
  std::thread thread;

  void accept();
};

// One connection.
class MetricsServer::Http::Visit : public std::enable_shared_from_this<Visit> {
 public:
  Visit(Http& server, tcp::socket socket) : server_(server), stream_(std::move(socket)) {
    ++server_.connections;
  }
  ~Visit() { --server_.connections; }

  void read() {
    parser_.emplace();
    parser_->header_limit(largest_header);
    parser_->body_limit(largest_body);
    stream_.expires_after(patience);
    http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](Error e, std::size_t) {
      if (!e) self->answer();
    });
  }

 private:
  void answer() {
    const auto& request = parser_->get();
    const boost::string_view host = request[http::field::host];
    if (!host.empty() && !is_loopback_host({host.data(), host.size()}))  // HTTP/1.0 has none
      return say(http::status::forbidden, "Ask by a loopback name.\n");
    if (request.method() != http::verb::get && request.method() != http::verb::head)
      return say(http::status::method_not_allowed, "GET alone.\n");
    if (request.target() != "/metrics") return say(http::status::not_found, "Here is /metrics alone.\n");
    try {
      say(http::status::ok, server_.page());
    } catch (const std::exception&) {  // no memory, say: the connection closes
    }
  }

  void say(http::status status, const std::string& text) {
    const auto& request = parser_->get();
    const bool ok = status == http::status::ok;
    response_ = http::response<http::string_body>(status, request.version());
    response_.set(http::field::content_type,
                  ok ? "text/plain; version=0.0.4; charset=utf-8" : "text/plain; charset=utf-8");
    if (status == http::status::method_not_allowed) response_.set(http::field::allow, "GET, HEAD");
    response_.keep_alive(ok && request.keep_alive());
    response_.content_length(text.size());
    if (request.method() != http::verb::head) response_.body() = text;
    http::async_write(stream_, response_, [self = shared_from_this()](Error e, std::size_t) {
      if (e) return;
      if (self->response_.keep_alive()) return self->read();
      Error ignored;
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    });
  }

  Http& server_;
  beast::tcp_stream stream_;
  beast::flat_buffer buffer_{largest_header + largest_body};
  std::optional<http::request_parser<http::string_body>> parser_;
  http::response<http::string_body> response_;
};

void MetricsServer::Http::accept() {
  acceptor.async_accept([this](Error e, tcp::socket socket) {
    if (e == asio::error::operation_aborted) return;
    // Above the limit the socket is closed as it goes.
    if (!e && connections < most_connections) std::make_shared<Visit>(*this, std::move(socket))->read();
    accept();
  });
}

MetricsServer::MetricsServer(const std::string& address, std::function<std::string()> page)
    : http_(std::make_unique<Http>()) {
  const tcp::endpoint endpoint = endpoint_of(address);
  http_->page = std::move(page);
  Error e;
  tcp::acceptor& acceptor = http_->acceptor;
  acceptor.open(endpoint.protocol(), e);
  if (!e) acceptor.set_option(asio::socket_base::reuse_address(true), e);
  if (!e) acceptor.bind(endpoint, e);
  if (!e) acceptor.listen(asio::socket_base::max_listen_connections, e);
  if (e) throw std::runtime_error("--metrics " + address + ": cannot listen there: " + e.message());
  http_->accept();
  http_->thread = std::thread([this] {
    name_thread("metrics");
    http_->io.run();
  });
}

MetricsServer::~MetricsServer() {
  http_->io.stop();
  http_->thread.join();
}

std::uint16_t MetricsServer::port() const noexcept {
  Error ignored;
  return http_->acceptor.local_endpoint(ignored).port();
}

}  // namespace hapticd
