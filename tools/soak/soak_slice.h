// One slice of a soak: a client for each device of a world on a daemon for some seconds, and what both saw.
//
// A client's motion is its instrument's trajectory, forth and back for ever, without pedals. The daemon's
// figures are the difference of two of its summaries, one behind the arming of all, one before the first lets
// go; of a daemon that is not ours, those that the answers carry. Each client has a participant of its own.
// Units are in the names. Errors: std::runtime_error.
#pragma once

#include <nlohmann/json.hpp>

#include "server/record/trajectory.h"
#include "tools/client/session.h"
#include "tools/soak/soak_daemon.h"
#include "tools/soak/tally.h"

namespace hapticd {

// What one daemon gave over some slices.
struct ServerFigures {
  Tally wake_us, timer_us, solve_us, write_us, interval_us, state_age_us, problem_age_ms, rtt_us,
      rtt_less_compute_us;
  std::int64_t scheduled = 0, sent = 0, answered = 0;   // the client's slots
  std::int64_t misses = 0, steps = 0, late_states = 0;  // the last: waited for (haptic/loop.h)
  double force_peak = 0;
  double seconds = 0;
  void merge(const ServerFigures& other);
};
nlohmann::ordered_json to_json(const ServerFigures& figures);

// The scene's motion, forth and back for ever, without pedals.
class SwingSource final : public SlotSource {
 public:
  // begin: of it, so that two hands need not move alike [s].
  explicit SwingSource(const Trajectory& trajectory, double begin = 0)
      : trajectory_(trajectory), offset_ms_(1e3 * begin), reached_ms_(offset_ms_) {}
  DeviceCommand first() const noexcept override { return pose_at(offset_ms_); }
  DeviceCommand at(std::int64_t k, std::int64_t, const NewestForce&, bool) noexcept override {
    reached_ms_ = offset_ms_ + static_cast<double>(k);
    return pose_at(reached_ms_);
  }
  void rest() noexcept { offset_ms_ = reached_ms_; }  // the next run goes on from here

 private:
  DeviceCommand pose_at(double ms) const noexcept {
    const double length = trajectory_.end() - trajectory_.begin();
    const double t = std::fmod(1e-3 * ms, 2 * length);
    return {sample_at(trajectory_, trajectory_.begin() + (t < length ? t : 2 * length - t)), 0};
  }
  const Trajectory& trajectory_;
  double offset_ms_, reached_ms_;
};

// A device and what moves it.
struct SoakHand {
  std::uint32_t device_id;
  SwingSource& source;
};

// daemon: ours, or null: the one that runs in the settings' domain. The clients' threads are on `core`.
// Figures of each hand.
std::vector<ServerFigures> client_slice(const ClientSettings& settings, int core, SoakDaemon* daemon,
                                        const std::vector<SoakHand>& hands, double seconds);

}  // namespace hapticd
