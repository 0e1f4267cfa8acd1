// The driver's two decisions as pure state machines: what the device may feel, and when to ask for force.
//
//   feel:    the newest force that answers a state of ours, for 10 ms after it came; else zero
//   enable:  false for the first 50 ms, then what the reading says; but when the daemon has kept the device
//            disarmed for 300 ms without a latch, false for 20 ms, so that it sees an edge and arms again
//
// Time: monotonic ns. Guarantee: noexcept, no allocation, wait-free.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "tools/driver/driver.h"

namespace hapticd {

inline constexpr std::int64_t force_silence_ns = 10'000'000;

class ForceWatch {
 public:
  explicit ForceWatch(double max_force) noexcept : max_force_(max_force) {}

  void sent(std::uint64_t number, std::int64_t time_ns) noexcept {
    state_[number % state_.size()] = {number, time_ns};
  }

  // A force that echoes that state; true: it is ours, and newer than any before.
  bool heard(std::int64_t now_ns, std::uint64_t number, std::int64_t time_ns, const Feel& feel) noexcept {
    const State& s = state_[number % state_.size()];
    if (number == 0 || s.number != number || s.time_ns != time_ns) return false;
    if (heard_ns_ > 0) longest_ns_ = std::max(longest_ns_, now_ns - heard_ns_);
    heard_ns_ = now_ns;
    silent_ = false;
    feel_ = limited(feel);
    const bool fresh = number > answered_;
    answered_ = std::max(answered_, number);
    return fresh;
  }

  Feel feel(std::int64_t now_ns) noexcept {
    if (heard_ns_ > 0 && now_ns - heard_ns_ < force_silence_ns) return feel_;
    if (heard_ns_ > 0 && !silent_) ++silences_;
    silent_ = true;
    return {};
  }

  std::uint64_t answered() const noexcept { return answered_; }  // number of the newest state answered
  std::uint32_t status() const noexcept { return feel_.status; }
  std::uint64_t silences() const noexcept { return silences_; }
  std::int64_t longest_silence_ns() const noexcept { return longest_ns_; }

 private:
  struct State {
    std::uint64_t number = 0;
    std::int64_t time_ns = 0;
  };

  Feel limited(Feel feel) const noexcept {
    double square = 0;
    bool finite = true;
    for (int i = 0; i < 3; ++i) {
      square += feel.force[i] * feel.force[i];
      finite = finite && std::isfinite(feel.force[i]) && std::isfinite(feel.torque[i]);
    }
    if (!finite) return {{}, {}, feel.status};
    if (max_force_ > 0 && square > max_force_ * max_force_) {
      const double scale = max_force_ / std::sqrt(square);
      for (double& f : feel.force) f *= scale;
      for (double& t : feel.torque) t *= scale;
    }
    return feel;
  }

  double max_force_;
  std::array<State, 256> state_{};  // a quarter of a second: an older echo is not felt
  Feel feel_;
  std::uint64_t answered_ = 0, silences_ = 0;
  std::int64_t heard_ns_ = 0, longest_ns_ = 0;
  bool silent_ = false;
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
