// A client's two decisions as pure state machines: what the device may feel, and when to ask for force.
//
//   feel:    the newest force that answers a state of ours, within the device's limits (haptic/limits.h):
//              ‖F‖ ≤ max_force, ‖τ‖ ≤ max_torque, all changes in one slot together ≤ max_force_rate · 1 ms
//            to zero within that rate, latched, while a second daemon is heard (`slot`)
//            zero at once where a force is not finite, and where none came for 7 ms, so that no device holds
//            one for longer than 10 ms
//   enable:  false for the first 50 ms, then what the reading says. If the daemon keeps the device disarmed
//            for 300 ms without a latch: false for 20 ms, so that the daemon sees an edge and arms again
//
// Time: monotonic ns. Guarantee: noexcept, no allocation, wait-free.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "haptic/limits.h"
#include "tools/client_library/feel.h"

namespace hapticd {

inline constexpr std::int64_t force_silence_ns = 7'000'000;
inline constexpr double slot_s = 1e-3;

class ForceWatch {
 public:
  explicit ForceWatch(const DeviceSettings& limits) noexcept : limits_(limits) {}

  // A slot begins. second_daemon: one is heard; enable: the reading's, whose false unlatches when none is.
  void slot(bool second_daemon, bool enable) noexcept {
    left_s_ = slot_s;
    latched_ = second_daemon || (latched_ && enable);
  }

  void sent(std::uint64_t number, std::int64_t time_ns) noexcept {
    state_[number % state_.size()] = {number, time_ns};
  }

  // Whether that state is one of ours, a quarter of a second old at most.
  bool ours(std::uint64_t number, std::int64_t time_ns) const noexcept {
    const State& s = state_[number % state_.size()];
    return number != 0 && s.number == number && s.time_ns == time_ns;
  }

  // A force that echoes that state; true: it is ours, and newer than any before.
  bool heard(std::int64_t now_ns, std::uint64_t number, std::int64_t time_ns, const Feel& feel) noexcept {
    if (!ours(number, time_ns)) return false;
    if (heard_ns_ > 0) longest_ns_ = std::max(longest_ns_, now_ns - heard_ns_);
    heard_ns_ = now_ns;
    silent_ = false;
    wanted_ = {Vec3(feel.force.data()), Vec3(feel.torque.data())};
    status_ = feel.status;
    const bool fresh = number > answered_;
    answered_ = std::max(answered_, number);
    return fresh;
  }

  // What to write to the device now.
  Feel feel(std::int64_t now_ns) noexcept {
    const std::uint32_t status = status_ | (latched_ ? std::uint32_t{status_rival} : 0u);
    if (is_silent(now_ns)) {
      silences_ += heard_ns_ > 0 && !silent_;
      silent_ = true;
      felt_ = {};
      return {{}, {}, latched_ ? status : std::uint32_t{status_disarmed}};
    }
    if (!is_finite(wanted_)) {
      felt_ = {};
      return {{}, {}, status | status_not_finite};
    }
    bool hit = false;
    const Wrench to = latched_ ? Wrench{} : saturated(limits_, wanted_, hit);
    const Wrench before = felt_;
    felt_ = slew_limited(limits_, before, to, left_s_, hit);
    left_s_ = std::max(0.0, left_s_ - time_for(felt_ - before));
    Feel out;
    out.status = status;
    for (int i = 0; i < 3; ++i) {
      out.force[static_cast<std::size_t>(i)] = felt_.force[i];
      out.torque[static_cast<std::size_t>(i)] = felt_.torque[i];
    }
    return out;
  }

  // The device goes to zero at once: there is nothing that it may feel.
  void zero() noexcept { felt_ = {}; }

  bool is_silent(std::int64_t now_ns) const noexcept {
    return heard_ns_ == 0 || now_ns - heard_ns_ >= force_silence_ns;
  }
  bool ever_heard() const noexcept { return heard_ns_ > 0; }
  std::uint64_t answered() const noexcept { return answered_; }  // number of the newest state answered
  std::uint32_t status() const noexcept { return status_; }
  bool latched() const noexcept { return latched_; }
  std::uint64_t silences() const noexcept { return silences_; }
  std::int64_t longest_silence_ns() const noexcept { return longest_ns_; }

 private:
  struct State {
    std::uint64_t number = 0;
    std::int64_t time_ns = 0;
  };

  // How long a change takes at the slew limit [s].
  double time_for(const Wrench& change) const noexcept {
    const double force = change.force.norm() / limits_.max_force_rate;
    if (limits_.max_torque <= 0) return force;
    const double torque_rate = limits_.max_force_rate * limits_.max_torque / limits_.max_force;
    return std::max(force, change.torque.norm() / torque_rate);
  }

  const DeviceSettings limits_;
  std::array<State, 256> state_{};  // a quarter of a second: an older echo is not felt
  Wrench wanted_, felt_;
  std::uint32_t status_ = 0;
  double left_s_ = slot_s;  // of this slot, for changes
  std::uint64_t answered_ = 0, silences_ = 0;
  std::int64_t heard_ns_ = 0, longest_ns_ = 0;
  bool silent_ = false, latched_ = false;
};

class Arming {
 public:
  bool enable(std::int64_t now_ns, bool wanted, bool disarmed, bool latched) noexcept {
    if (begun_ns_ == 0) begun_ns_ = armed_ns_ = now_ns;
    if (now_ns - begun_ns_ < first_ns) armed_ns_ = now_ns;
    if (now_ns - begun_ns_ < first_ns || now_ns < low_until_ns_) return false;
    if (!wanted || !disarmed || latched) armed_ns_ = now_ns;
    if (now_ns - armed_ns_ < patience_ns) return wanted;
    armed_ns_ = low_until_ns_ = now_ns + low_ns;
    return false;
  }

 private:
  static constexpr std::int64_t first_ns = 50'000'000, patience_ns = 300'000'000, low_ns = 20'000'000;
  std::int64_t begun_ns_ = 0, armed_ns_ = 0, low_until_ns_ = 0;
};

}  // namespace hapticd
