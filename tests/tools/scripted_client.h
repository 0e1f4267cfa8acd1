// A device on DDS whose every state a test decides, and all that it was answered.
//
// A thread sends the present state each millisecond; `next` may bend one before it leaves. Forces are kept as
// they come, in Cyclone's receive thread, from the first daemon heard alone.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "haptic/clock.h"
#include "haptic/device.h"
#include "server/dds/force_reader.h"

namespace hapticd {

class ScriptedClient {
 public:
  using State = hapticd_msg_DeviceState;
  using Force = hapticd_msg_ForceCommand;

  // silent: only listens, until told otherwise.
  explicit ScriptedClient(const Participant& participant, std::uint32_t device_id = 0, bool silent = false)
      : silent_(silent), writer_(participant), reader_(participant, device_id, ForceReader::Side::client) {
    state_.device_id = device_id;
    state_.orientation[3] = 1;
    state_.position[2] = 0.030;
    state_.number = static_cast<std::uint64_t>(monotonic_ns() / 1'000'000);
    const std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> listener(dds_create_listener(this),
                                                                                   &dds_delete_listener);
    dds_lset_data_available(listener.get(),
                            [](dds_entity_t, void* self) { static_cast<ScriptedClient*>(self)->receive(); });
    require(dds_set_listener(reader_.handle(), listener.get()), "a listener");
    thread_ = std::thread([this] { run(); });
  }
  ~ScriptedClient() { leave(); }

  // Ends sending; what it last sent is disposed of by the writer's end, not before.
  void leave() {
    stopping_ = true;
    if (thread_.joinable()) thread_.join();
    dds_set_listener(reader_.handle(), nullptr);
  }
  void dispose() {
    silent(true);
    writer_.dispose(state_);
  }

  // Edits the state that all later ones are like.
  void change(const std::function<void(State&)>& edit) {
    const std::lock_guard lock(sending_);
    edit(state_);
  }
  // Edits each of the next `count` states alone.
  void bend(int count, std::function<void(State&)> edit) {
    const std::lock_guard lock(sending_);
    bend_ = std::move(edit);
    bends_ = count;
  }
  void silent(bool yes) {
    const std::lock_guard lock(sending_);
    silent_ = yes;
  }
  void enable(bool yes) {
    change([yes](State& s) { s.enable = yes; });
  }
  // So many states in each millisecond, one behind the other.
  void flood(int states) {
    const std::lock_guard lock(sending_);
    states_ = states;
  }
  // Moves straight down or up, over so many milliseconds.
  void move_to(double z, int milliseconds) {
    double from = 0;
    change([&](State& s) { from = s.position[2]; });
    for (int i = 1; i <= milliseconds; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      change([&](State& s) { s.position[2] = from + (z - from) * i / milliseconds; });
    }
  }

  // All forces since index `from`; the number of those before.
  std::vector<Force> forces(std::size_t from = 0) const {
    const std::lock_guard lock(receiving_);
    return {forces_.begin() + static_cast<std::ptrdiff_t>(std::min(from, forces_.size())), forces_.end()};
  }
  // Between two milliseconds' states: the machine may hold up the client itself.
  std::int64_t longest_pause_ms() const { return longest_pause_ns_ / 1'000'000; }
  std::uint64_t strange_forces() const { return reader_.strange_forces(); }
  std::size_t count() const {
    const std::lock_guard lock(receiving_);
    return forces_.size();
  }
  // Waits until a force that came after the call (or after index `from`) is such.
  bool await(int milliseconds, const std::function<bool(const Force&)>& such,
             std::size_t from = ~std::size_t{0}) {
    std::size_t seen = from == ~std::size_t{0} ? count() : from;
    for (int i = 0; i < milliseconds; ++i) {
      for (const Force& f : forces(seen)) {
        ++seen;
        if (such(f)) return true;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return false;
  }
  static double magnitude(const Force& f) { return std::hypot(f.force[0], f.force[1], f.force[2]); }

 private:
  void run() {
    auto next = std::chrono::steady_clock::now();
    std::int64_t before = monotonic_ns();
    while (!stopping_) {
      // What was missed is not sent late; and who wants to change the states gets his turn in a flood, too.
      next = std::max(next + std::chrono::milliseconds(1),
                      std::chrono::steady_clock::now() + std::chrono::microseconds(100));
      std::this_thread::sleep_until(next);
      const std::lock_guard lock(sending_);
      const std::int64_t now = monotonic_ns();
      longest_pause_ns_ = std::max(longest_pause_ns_.load(), now - before);
      before = now;
      for (int i = 0; i < states_; ++i) send();
    }
  }
  void send() {
    ++state_.number;
    if (silent_) return;
    State sent = state_;
    sent.client_time_ns = monotonic_ns();
    if (bends_ > 0) {
      --bends_;
      bend_(sent);
    }
    writer_.write(sent);
  }
  void receive() noexcept {
    std::array<Force, 4> taken;
    std::array<dds_sample_info_t, 4> infos;
    const int n = reader_.take_into(taken, infos);
    const std::lock_guard lock(receiving_);
    for (int i = 0; i < n; ++i)
      if (infos[static_cast<std::size_t>(i)].valid_data)
        forces_.push_back(taken[static_cast<std::size_t>(i)]);
  }

  std::mutex sending_;
  State state_{};
  std::function<void(State&)> bend_;
  int bends_ = 0, states_ = 1;
  bool silent_ = false;
  mutable std::mutex receiving_;
  std::vector<Force> forces_;
  std::atomic<bool> stopping_{false};
  std::atomic<std::int64_t> longest_pause_ns_{0};
  Writer<State> writer_;
  ForceReader reader_;
  std::thread thread_;
};

}  // namespace hapticd
