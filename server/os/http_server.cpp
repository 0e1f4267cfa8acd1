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
    place_ = server_.visits_.insert(server_.visits_.end(), this);
  }
  ~Visit() { leave(); }
  Visit(const Visit&) = delete;
  Visit& operator=(const Visit&) = delete;

  // Whoever waits for it hears an error, and lets go.
  void close() noexcept {
    leave();
    Error ignored;
    stream_.socket().close(ignored);
  }

  void read() {
    step();
    parser_.emplace();
    parser_->header_limit(static_cast<std::uint32_t>(server_.limits_.header));
    parser_->body_limit(server_.limits_.body);
    stream_.expires_after(server_.limits_.patience);
    http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](Error e, std::size_t) {
      if (!e) self->answer();
    });
  }

 private:
  using Place = std::list<Visit*>::iterator;

  void step() noexcept {
    if (place_) server_.visits_.splice(server_.visits_.end(), server_.visits_, *place_);
  }
  void leave() noexcept {
    if (place_) server_.visits_.erase(*place_);
    place_.reset();
  }

  void answer() {
    step();
    const Request& request = parser_->get();
    // Which of two would be meant, a proxy and this server may see differently.
    if (request.count(http::field::host) > 1)
      return say(http_text(http::status::bad_request, "One Host, not several.\n"));
    std::optional<Response> response;
    try {
      response = server_.handlers_.answer(request);
    } catch (const std::exception&) {  // no memory, say: the connection closes
      return;
    }
    if (response) return say(std::move(*response));
    stream_.expires_never();
    leave();
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
  std::optional<Place> place_;
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

bool HttpServer::close_oldest() noexcept {
  if (visits_.empty()) return false;
  visits_.front()->close();
  return true;
}

void HttpServer::accept() {
  acceptor_.async_accept([this](Error e, Socket socket) {
    if (e == asio::error::operation_aborted) return;
    if (!e) {
      if (connections_ < limits_.connections || close_oldest())
        std::make_shared<Visit>(*this, std::move(socket))->read();
      return accept();
    }
    // No descriptor, say: the connection stays in the queue, and asking again at once would ask for ever.
    close_oldest();
    pause_.expires_after(std::chrono::milliseconds(100));
    pause_.async_wait([this](Error cancelled) {
      if (!cancelled) accept();
    });
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
