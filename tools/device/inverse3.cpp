#include "tools/device/inverse3.h"

#include <sys/socket.h>

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <mutex>
#include <optional>
#include <stdexcept>

#include "tools/device/inverse3_messages.h"
#include "tools/device/shared_library.h"

namespace hapticd {
namespace {

namespace beast = boost::beast;
namespace asio = boost::asio;
using tcp = asio::ip::tcp;

constexpr auto patience = std::chrono::seconds(2);  // for a connection and its first message
constexpr int most_unanswered = 2;

class Inverse3Device final : public VendorDevice {
 public:
  Inverse3Device(const Inverse3Address& address, const std::string& device) : place_(address.host + ":" + address.port) {
    connect(address);
    const Inverse3State* found = nullptr;
    await([&] { return state_.has_value(); }, "its first message");
    found = state_->find(device);
    if (!found)
      throw std::runtime_error("the service at " + place_ + " has no Inverse3" +
                               (device.empty() ? ": is it plugged in and powered?" : " with the id " + device));
    id_ = found->id;
    name_ = "Inverse3 " + id_ + (found->side.empty() ? "" : ", " + found->side + "-handed");
    newer_ = state_->newer;
    send({}, true);
  }
  ~Inverse3Device() override {
    command({});
    const std::lock_guard hold(lock_);
    beast::error_code ignored;
    if (!error_) io_.run_for(std::chrono::milliseconds(5));  // the zero leaves
    beast::get_lowest_layer(stream_).socket().shutdown(tcp::socket::shutdown_both, ignored);
    beast::get_lowest_layer(stream_).socket().close(ignored);
    io_.restart();
    io_.poll();  // what was under way ends with an error
  }

  bool sample(Sample& sample) noexcept override try {
    const std::lock_guard hold(lock_);
    turn();
    if (error_) return false;
    const Inverse3State* state = state_->find(id_);
    if (!state) {
      gone_ = true;
      return false;
    }
    sample.at_ns = answered_ns_;
    sample.reading.position = state->position;
    sample.reading.orientation = state->orientation;
    sample.reading.buttons = state->buttons;
    asks_ = !state->ready         ? "the Inverse3 is not ready: connect its power supply"
            : !state->calibrated ? "calibrate the Inverse3, as its maker's manual says"
                                 : "";
    return true;
  } catch (const std::exception& error) {
    thrown_ = error.what();
    return false;
  }

  void command(const Feel& feel) noexcept override try {
    const std::lock_guard hold(lock_);
    wanted_ = feel.force;
    send_wanted();
  } catch (const std::exception& error) {
    thrown_ = error.what();
  }

  void motors(bool on) noexcept override {
    if (on) return;
    if (lock_.try_lock()) {
      wanted_ = {};
      try {
        send_wanted();
      } catch (...) {  // the next sample tells
      }
      lock_.unlock();
    } else {
      ::shutdown(socket_.load(), SHUT_RDWR);  // a service without its client sets the device idle
    }
  }

  std::string name() const override { return name_; }
  std::string fault() const override {
    if (!thrown_.empty()) return thrown_;
    return gone_ ? "the service no longer lists " + id_ : "the service at " + place_ + ": " + error_.message();
  }
  const char* asks() const noexcept override { return asks_; }

 private:
  void connect(const Inverse3Address& address) {
    tcp::resolver resolver(io_);
    beast::error_code error;
    const auto endpoints = resolver.resolve(address.host, address.port, error);
    if (error) throw MissingLibrary(place_ + ": " + error.message());
    bool connected = false;
    beast::get_lowest_layer(stream_).async_connect(endpoints, [&](beast::error_code e, const tcp::endpoint&) {
      error_ = e;
      connected = true;
    });
    await([&] { return connected; }, "a connection");
    socket_.store(beast::get_lowest_layer(stream_).socket().native_handle());
    beast::get_lowest_layer(stream_).socket().set_option(tcp::no_delay(true));
    bool shaken = false;
    stream_.async_handshake(place_, "/", [&](beast::error_code e) {
      error_ = e;
      shaken = true;
    });
    await([&] { return shaken; }, "a WebSocket handshake");
    stream_.text(true);
    stream_.read_message_max(1 << 20);
    read_next();
  }

  // Runs what is under way until it is done.
  template <typename Done>
  void await(const Done& done, const char* what) {
    const auto end = std::chrono::steady_clock::now() + patience;
    while (!done() && !error_ && std::chrono::steady_clock::now() < end) {
      io_.restart();
      io_.run_one_until(end);
    }
    const beast::error_code error = error_;
    if (done() && !error) return;
    // Handlers that look into this call's frame must not outlive it.
    beast::error_code ignored;
    beast::get_lowest_layer(stream_).socket().close(ignored);
    io_.restart();
    io_.run_for(std::chrono::milliseconds(100));
    throw MissingLibrary("no Inverse service at " + place_ + ": " +
                             (error ? error.message() : std::string("no answer to ") + what + " within 2 s"));
  }

  void read_next() {
    stream_.async_read(buffer_, [this](beast::error_code e, std::size_t) {
      if (e) {
        error_ = e;
        return;
      }
      const auto data = buffer_.cdata();
      if (auto message = parse_inverse3({static_cast<const char*>(data.data()), data.size()})) {
        state_ = std::move(*message);
        answered_ns_ = device_clock_ns();
      }
      buffer_.consume(buffer_.size());
      if (unanswered_ > 0) --unanswered_;
      read_next();
    });
  }

  // All that is ready, without waiting. Answers make room for a force that had none.
  void turn() {
    io_.restart();
    io_.poll();
    send_wanted();
  }

  void send_wanted() {
    if (error_ || writing_ || !wanted_) return;
    const bool zero = *wanted_ == std::array<double, 3>{};
    if (unanswered_ >= most_unanswered && !(zero && !zero_last_)) return;
    send(*wanted_, false);
  }

  void send(const std::array<double, 3>& force, bool first) {
    outgoing_ = inverse3_force(id_, force, newer_, first);
    zero_last_ = force == std::array<double, 3>{};
    wanted_.reset();
    writing_ = true;
    ++unanswered_;
    stream_.async_write(asio::buffer(outgoing_), [this](beast::error_code e, std::size_t) {
      writing_ = false;
      if (e) error_ = e;
    });
    io_.restart();
    io_.poll();
  }

  const std::string place_;
  asio::io_context io_{1};
  beast::websocket::stream<beast::tcp_stream> stream_{io_};
  beast::flat_buffer buffer_;
  std::mutex lock_;
  std::atomic<int> socket_{-1};
  std::optional<Inverse3Message> state_;
  std::optional<std::array<double, 3>> wanted_;  // not yet sent
  std::string id_, name_, outgoing_, thrown_;
  beast::error_code error_;
  const char* asks_ = "";
  std::int64_t answered_ns_ = 0;
  int unanswered_ = 0;
  bool newer_ = false, writing_ = false, zero_last_ = true, gone_ = false;
};

}  // namespace

Inverse3Address inverse3_address(const std::string& text) {
  Inverse3Address out;
  if (text.empty()) return out;
  const std::size_t colon = text.rfind(':');
  if (colon != std::string::npos) out.host = text.substr(0, colon);
  out.port = colon == std::string::npos ? text : text.substr(colon + 1);
  const bool digits = !out.port.empty() && out.port.find_first_not_of("0123456789") == std::string::npos;
  if (!digits || out.port.size() > 5 || out.host.empty())
    throw std::invalid_argument("--service " + text + ": PORT or HOST:PORT is expected");
  return out;
}

std::unique_ptr<VendorDevice> open_inverse3(const Inverse3Address& address, const std::string& device) {
  return std::make_unique<Inverse3Device>(address, device);
}

}  // namespace hapticd
