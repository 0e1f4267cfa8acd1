// HTTP on one address: requests are answered one after the other, in a thread of the server's own.
//
//   accept → read a request → answer(request) → write → the next request, or the end
//
// The handler says status, headers and body. Length, HEAD, keep-alive and the `Allow` of a 405 are added
// here; a request with two `Host` is a 400. Where it answers nothing, `take_over` gets the connection (a
// WebSocket); without one the connection closes, as after an exception. A connection that comes above
// `Limits::connections`, or when there is no descriptor, takes the place of the one that has gone longest
// without a step; where all are taken over it closes. One that is silent for `patience` closes too. Thread
// safety: handlers run in the server's thread, at the priority of its maker; all else belongs to the maker.
// Errors: the constructor throws boost::system::system_error where it cannot listen.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <thread>

namespace hapticd {

class HttpServer {
 public:
  using Socket = boost::asio::ip::tcp::socket;
  using Request = boost::beast::http::request<boost::beast::http::string_body>;
  using Response = boost::beast::http::response<boost::beast::http::string_body>;
  // Counts as a connection for as long as somebody has it.
  using Ticket = std::shared_ptr<void>;

  struct Limits {
    int connections = 16;
    std::chrono::seconds patience{5};
    std::size_t header = 8192, body = 0;  // bytes
  };
  struct Handlers {
    std::function<std::optional<Response>(const Request&)> answer;
    std::function<void(const Request&, Socket, Ticket)> take_over = {};
  };

  // thread_name: 15 characters.
  HttpServer(const boost::asio::ip::tcp::endpoint& endpoint, const Limits& limits, Handlers handlers,
             const char* thread_name);
  ~HttpServer() { stop(); }
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  // No handler runs afterwards. What took connections over has to let them go before the server ends.
  void stop() noexcept;

  boost::asio::io_context& io() noexcept { return io_; }
  std::uint16_t port() const noexcept;

 private:
  class Visit;

  void accept();
  bool close_oldest() noexcept;

  const Limits limits_;
  const Handlers handlers_;
  int connections_ = 0;
  std::list<Visit*> visits_;       // not yet taken over; in the order of their last steps, the oldest first
  boost::asio::io_context io_{1};  // ends before the above, which its handlers use
  boost::asio::ip::tcp::acceptor acceptor_{io_};
  boost::asio::steady_timer pause_{io_};  // where there is no descriptor
  std::thread thread_;
};

// A text with its type.
HttpServer::Response http_text(boost::beast::http::status status, const std::string& text,
                               const std::string& type = "text/plain; charset=utf-8");

}  // namespace hapticd
