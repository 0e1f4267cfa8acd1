#include "server/os/http_server.h"

#include <boost/beast/core.hpp>
#include <exception>
#include <utility>

#include "server/os/realtime.h"

namespace hapticd {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using tcp = asio::ip::tcp;
using Error = boost::system::error_code;

// One connection.
class HttpServer::Visit : public std::enable_shared_from_this<Visit> {
 public:
  Visit(HttpServer& server, Socket socket)
      : server_(server),
        stream_(std::move(socket)),
        ticket_(&server, [](HttpServer* s) { --s->connections_; }) {
    ++server_.connections_;
  }

  void read() {
    parser_.emplace();
    parser_->header_limit(static_cast<std::uint32_t>(server_.limits_.header));
    parser_->body_limit(server_.limits_.body);
    stream_.expires_after(server_.limits_.patience);
    http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](Error e, std::size_t) {
      if (!e) self->answer();
    });
  }

 private:
  void answer() {
    const Request& request = parser_->get();
    std::optional<Response> response;
    try {
      response = server_.handlers_.answer(request);
    } catch (const std::exception&) {  // no memory, say: the connection closes
      return;
    }
    if (response) return say(std::move(*response));
    stream_.expires_never();
    if (server_.handlers_.take_over)
      server_.handlers_.take_over(request, stream_.release_socket(), std::move(ticket_));
  }

  void say(Response response) {
    const Request& request = parser_->get();
    response_ = std::move(response);
    response_.version(request.version());
    if (response_.result() == http::status::method_not_allowed)
      response_.set(http::field::allow, "GET, HEAD");
    response_.keep_alive(response_.result() == http::status::ok && request.keep_alive());
    response_.content_length(response_.body().size());
    if (request.method() == http::verb::head) response_.body().clear();
    http::async_write(stream_, response_, [self = shared_from_this()](Error e, std::size_t) {
      if (e) return;
      if (self->response_.keep_alive()) return self->read();
      Error ignored;
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    });
  }

  HttpServer& server_;
  beast::tcp_stream stream_;
  Ticket ticket_;
  beast::flat_buffer buffer_{2 * server_.limits_.header + server_.limits_.body};
  std::optional<http::request_parser<http::string_body>> parser_;
  Response response_;
};

HttpServer::HttpServer(const tcp::endpoint& endpoint, const Limits& limits, Handlers handlers,
                       const char* thread_name)
    : limits_(limits), handlers_(std::move(handlers)) {
  acceptor_.open(endpoint.protocol());
  acceptor_.set_option(asio::socket_base::reuse_address(true));
  acceptor_.bind(endpoint);
  acceptor_.listen();
  accept();
  thread_ = std::thread([this, thread_name] {
    name_thread(thread_name);
    io_.run();
  });
}

void HttpServer::stop() noexcept {
  io_.stop();
  if (thread_.joinable()) thread_.join();
}

void HttpServer::accept() {
  acceptor_.async_accept([this](Error e, Socket socket) {
    if (e == asio::error::operation_aborted) return;
    if (!e && connections_ < limits_.connections) std::make_shared<Visit>(*this, std::move(socket))->read();
    accept();
  });
}

std::uint16_t HttpServer::port() const noexcept {
  Error ignored;
  return acceptor_.local_endpoint(ignored).port();
}

HttpServer::Response http_text(http::status status, const std::string& text, const std::string& type) {
  HttpServer::Response response;
  response.result(status);
  response.set(http::field::content_type, type);
  response.body() = text;
  return response;
}

}  // namespace hapticd
