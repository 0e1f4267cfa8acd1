// Haply's Inverse service as its documentation describes it, for one Inverse3 that is a FakeDevice: a first
// message with the inventory, then one state for each message that comes. A client that goes leaves it idle.
#pragma once

#include <poll.h>

#include <atomic>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <nlohmann/json.hpp>
#include <thread>

#include "tests/support/devices/fake_device.h"

namespace hapticd {

class FakeInverse3 {
 public:
  FakeInverse3(FakeDevice& device, bool newer) : device_(device), newer_(newer) {
    thread_ = std::thread([this] { serve(); });
  }
  ~FakeInverse3() {
    stopping_ = true;
    // Accepting ends with a client that is none; reading ends with its connection.
    boost::beast::error_code ignored;
    tcp::socket last(io_);
    last.connect(acceptor_.local_endpoint(), ignored);
    last.close(ignored);
    close_client();
    thread_.join();
  }
  std::string port() const { return std::to_string(acceptor_.local_endpoint().port()); }
  std::string profile() const { return profile_; }  // once the client is gone

 private:
  using tcp = boost::asio::ip::tcp;
  using Stream = boost::beast::websocket::stream<tcp::socket>;

  void close_client() {
    if (const int socket = socket_.load(); socket >= 0) ::shutdown(socket, SHUT_RDWR);
  }

  std::string state(bool whole) const {
    nlohmann::json device = {
        {"device_id", "049D"},
        {"state",
         {{"cursor_position",
           {{"x", device_.position[0].load()}, {"y", device_.position[1].load()}, {"z", device_.position[2].load()}}},
          {"cursor_velocity", {{"x", 0.0}, {"y", 0.0}, {"z", 0.0}}}}},
        {"status", {{"calibrated", device_.calibrated.load()}, {"ready", true}, {"power_supply", true}}}};
    if (whole) device["config"] = {{"handedness", "left"}, {"type", "inverse3"}};
    const unsigned b = device_.buttons;
    const nlohmann::json grip = {
        {"device_id", "61548"},
        {"state",
         {{"orientation", {{"x", 0.0}, {"y", 0.6}, {"z", 0.0}, {"w", 0.8}}},
          {"buttons", {{"a", (b & 1) != 0}, {"b", (b & 2) != 0}, {"c", (b & 4) != 0}}}}}};
    nlohmann::json message = {{"inverse3", nlohmann::json::array({device})},
                              {"wireless_verse_grip", nlohmann::json::array({grip})}};
    if (device_.fault == FakeDevice::unplugged) message["inverse3"] = nlohmann::json::array();
    if (newer_) message["session_id"] = 7;
    return message.dump();
  }

  void serve() {
    while (!stopping_) {
      tcp::socket socket(io_);
      boost::beast::error_code error;
      acceptor_.accept(socket, error);
      if (error || stopping_) return;
      socket.set_option(tcp::no_delay(true));
      socket_ = socket.native_handle();
      Stream stream(std::move(socket));
      try {
        talk(stream);
      } catch (const std::exception&) {  // the client is gone
      }
      socket_ = -1;
      device_.set_force(0, 0, 0);
    }
  }

  void talk(Stream& stream) {
    stream.accept();
    stream.text(true);
    stream.write(boost::asio::buffer(state(true)));
    device_.motors = true;
    int unanswered = 0;
    std::int64_t answered_ns = 0;
    for (;;) {
      boost::beast::flat_buffer buffer;
      stream.read(buffer);
      const auto message = nlohmann::json::parse(boost::beast::buffers_to_string(buffer.data()));
      const auto& one = message.at("inverse3").at(0);
      const auto& force = one.at("commands").at("set_cursor_force").at(newer_ ? "vector" : "values");
      if (one.at("device_id") == "049D") device_.set_force(force.at("x"), force.at("y"), force.at("z"));
      if (message.contains("session")) profile_ = message["session"]["configure"]["profile"]["name"];
      if (device_.fault == FakeDevice::hangs) continue;  // hears, and does not answer
      if (device_.fault == FakeDevice::call_fails) return;
      ++unanswered;
      while (unanswered > 0 && (device_.fault != FakeDevice::slow || await_until(answered_ns + 50'000'000))) {
        stream.write(boost::asio::buffer(state(false)));
        answered_ns = FakeDevice::now_ns();
        --unanswered;
      }
    }
  }

  // A slow service hears at once and answers late: false as soon as there is something to hear.
  bool await_until(std::int64_t time_ns) const {
    pollfd ready{socket_, POLLIN, 0};
    const std::int64_t left = time_ns - FakeDevice::now_ns();
    return left <= 0 || poll(&ready, 1, static_cast<int>(left / 1'000'000) + 1) == 0;
  }

  FakeDevice& device_;
  const bool newer_;
  boost::asio::io_context io_;
  tcp::acceptor acceptor_{io_, tcp::endpoint(boost::asio::ip::address_v4::loopback(), 0)};
  std::atomic<int> socket_{-1};
  std::atomic<bool> stopping_{false};
  std::string profile_;
  std::thread thread_;
};

}  // namespace hapticd
