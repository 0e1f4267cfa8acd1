#include "tools/view/page_server.h"

#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <list>
#include <optional>
#include <set>

#include "server/os/host_name.h"
#include "server/os/http_server.h"
#include "tools/cli/command.h"

namespace hapticd {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;
using Error = boost::system::error_code;
using Request = HttpServer::Request;

constexpr HttpServer::Limits limits{.connections = 32, .patience = std::chrono::seconds(10), .header = 8192};
constexpr std::size_t largest_text = 4096;
// What the kernel may hold of messages that a slow viewer has not taken: a fraction of a second of them.
constexpr int send_buffer = 256 * 1024;

std::string view_of(boost::string_view v) { return std::string(v.data(), v.size()); }

}  // namespace

struct PageServer::Running {
  class Viewer;

  PageFiles files;
  std::function<void(std::uint64_t, const std::string&)> heard;
  bool loopback = true;
  std::list<SharedMessage> kept;  // in the order in which their keys first came
  std::uint64_t last_viewer = 0;
  std::atomic<int> viewer_count{0};
  std::atomic<std::uint64_t> dropped{0};
  std::set<std::shared_ptr<Viewer>> viewers;
  std::optional<HttpServer> listener;  // ends before the above, which its handlers use

  explicit Running(PageFiles f) : files(std::move(f)) {}

  bool is_host_allowed(std::string_view host) const {
    return loopback ? is_loopback_host(host) : is_address_host(host);
  }
  void listen(const PageServerSettings& settings);
  std::optional<HttpServer::Response> answer(const Request& request) const;
  void put(SharedMessage message);
};

// One WebSocket.
class PageServer::Running::Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  Viewer(Running& server, tcp::socket socket, HttpServer::Ticket ticket, std::uint64_t number)
      : server_(server), ticket_(std::move(ticket)), stream_(std::move(socket)), number_(number) {}

  void start(const Request& request) {
    auto timeout = websocket::stream_base::timeout::suggested(beast::role_type::server);
    timeout.idle_timeout = limits.patience;  // asks by a ping half-way
    timeout.keep_alive_pings = true;
    stream_.set_option(timeout);
    stream_.read_message_max(largest_text);
    stream_.auto_fragment(false);
    Error ignored;
    beast::get_lowest_layer(stream_).socket().set_option(asio::socket_base::send_buffer_size(send_buffer),
                                                         ignored);
    beast::get_lowest_layer(stream_).socket().set_option(tcp::no_delay(true), ignored);
    stream_.async_accept(request, [self = shared_from_this()](Error e) {
      if (e) return self->end();
      self->server_.viewers.insert(self);
      self->server_.viewer_count.store(static_cast<int>(self->server_.viewers.size()));
      for (const SharedMessage& m : self->server_.kept) self->outbox_.put(m);
      self->write();
      self->read();
    });
  }
  void put(const SharedMessage& message) {
    const std::uint64_t before = outbox_.dropped();
    outbox_.put(message);
    server_.dropped += outbox_.dropped() - before;
    if (!on_its_way_) write();
  }
  void close() {
    Error ignored;
    beast::get_lowest_layer(stream_).socket().close(ignored);
  }

 private:
  void write() {
    on_its_way_ = outbox_.next();
    if (!on_its_way_) return;
    stream_.binary(on_its_way_->binary);
    stream_.async_write(asio::buffer(on_its_way_->bytes), [self = shared_from_this()](Error e, std::size_t) {
      if (e) return self->end();
      self->write();
    });
  }
  void read() {
    stream_.async_read(text_, [self = shared_from_this()](Error e, std::size_t) {
      if (e) return self->end();
      const std::string text = beast::buffers_to_string(self->text_.data());
      self->text_.consume(self->text_.size());
      if (!text.empty()) self->server_.heard(self->number_, text);
      self->read();
    });
  }
  void end() {
    if (ended_) return;
    ended_ = true;
    close();
    ticket_.reset();
    if (server_.viewers.erase(shared_from_this()) > 0) {
      server_.viewer_count.store(static_cast<int>(server_.viewers.size()));
      server_.heard(number_, "");
    }
  }

  Running& server_;
  HttpServer::Ticket ticket_;
  websocket::stream<beast::tcp_stream> stream_;
  beast::flat_buffer text_;
  Outbox outbox_;
  SharedMessage on_its_way_;
  const std::uint64_t number_;
  bool ended_ = false;
};

// Nothing: a WebSocket for the page itself.
std::optional<HttpServer::Response> PageServer::Running::answer(const Request& request) const {
  const auto say = [](http::status status, const std::string& type, const std::string& body) {
    HttpServer::Response response = http_text(status, body, type);
    response.set(http::field::cache_control, "no-cache");
    response.set("X-Content-Type-Options", "nosniff");
    response.set("Referrer-Policy", "no-referrer");
    response.set(
        "Content-Security-Policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
    return response;
  };
  const std::string host = view_of(request[http::field::host]);
  const std::string origin = view_of(request[http::field::origin]);
  const std::string target = view_of(request.target());
  if (!is_host_allowed(host))
    return say(http::status::forbidden, "text/plain", "Ask by a loopback address.\n");
  // A browser always names the page that opens a WebSocket: it must be this one.
  if (!origin.empty() && host_of_origin(origin) != host)
    return say(http::status::forbidden, "text/plain", "Not from another page.\n");
  if (websocket::is_upgrade(request)) {
    if (target == "/live") return {};
    return say(http::status::not_found, "text/plain", "The WebSocket is /live.\n");
  }
  if (request.method() != http::verb::get && request.method() != http::verb::head)
    return say(http::status::method_not_allowed, "text/plain", "GET alone.\n");
  if (const PageFile* file = files.find(target)) return say(http::status::ok, file->type, file->bytes);
  return say(http::status::not_found, "text/plain", "No such file.\n");
}

void PageServer::Running::listen(const PageServerSettings& settings) {
  Error e;
  const asio::ip::address address = asio::ip::make_address(settings.address, e);
  if (e) throw UsageError("--listen " + settings.address + ": is not an address");
  loopback = address.is_loopback();
  const auto take_over = [this](const Request& request, tcp::socket socket, HttpServer::Ticket ticket) {
    std::make_shared<Viewer>(*this, std::move(socket), std::move(ticket), ++last_viewer)->start(request);
  };
  try {
    listener.emplace(tcp::endpoint(address, settings.port), limits,
                 HttpServer::Handlers{[this](const Request& r) { return answer(r); }, take_over}, "page");
  } catch (const boost::system::system_error& failed) {
    throw std::runtime_error("cannot listen on " + settings.address + ", port " +
                             std::to_string(settings.port) + ": " + failed.code().message() +
                             (failed.code() == asio::error::address_in_use ? "; try --port 0" : ""));
  }
}

void PageServer::Running::put(SharedMessage message) {
  bool known = false;
  for (SharedMessage& m : kept)
    if (m->key == message->key) {
      m = message;
      known = true;
    }
  if (!known) kept.push_back(message);
  for (const auto& viewer : viewers) viewer->put(message);
}

PageServer::PageServer(const PageServerSettings& settings, PageFiles files,
                       std::function<void(std::uint64_t, const std::string&)> heard)
    : running_(std::make_unique<Running>(std::move(files))) {
  running_->heard = std::move(heard);
  running_->listen(settings);
}

PageServer::~PageServer() {
  running_->listener->stop();
  running_->viewers.clear();
}

void PageServer::put(SharedMessage message) {
  asio::post(running_->listener->io(), [this, message = std::move(message)] { running_->put(message); });
}

void PageServer::forget(const std::string& key_begins) {
  asio::post(running_->listener->io(), [this, key_begins] {
    running_->kept.remove_if([&](const SharedMessage& m) { return m->key.starts_with(key_begins); });
  });
}

int PageServer::viewers() const noexcept { return running_->viewer_count.load(); }
std::uint64_t PageServer::dropped() const noexcept { return running_->dropped.load(); }
std::uint16_t PageServer::port() const noexcept { return running_->listener->port(); }

}  // namespace hapticd
