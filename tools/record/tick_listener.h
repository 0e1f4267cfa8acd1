// The ticks of one device as they cross DDS: each force, with the state that it answers.
//
//   state n from any client of the device  ┐
//                                          ├→ force whose echo_number is n → ForceRecord
//   force from the daemon                  ┘
//
// A record's time is the force's arrival, as the daemon's own tick is not sent; `instrument` has buttons and
// the state's arrival alone, and the client's own time is in `force`. A force whose state was not heard (both
// are best effort), or that answers no new one, has no pose. Threads: states and forces are taken in
// Cyclone's receive threads and go through queues; take and take_statuses belong to one thread. Errors: the
// constructor throws std::runtime_error.
#pragma once

#include <array>
#include <functional>

#include "haptic/loop.h"
#include "haptic/spsc_queue.h"
#include "server/dds/dds.h"
#include "server/record/ros2_messages.h"

namespace hapticd {

class TickListener {
 public:
  TickListener(const Participant& participant, std::uint32_t device_id);
  ~TickListener();
  TickListener(const TickListener&) = delete;
  TickListener& operator=(const TickListener&) = delete;

  // What came since the last call.
  void take(const std::function<void(const ForceRecord&)>& sink);
  void take_statuses(const std::function<void(const Diagnostic&)>& sink);

  std::uint64_t without_pose() const noexcept { return without_pose_; }  // answers to states not heard
  std::uint64_t dropped() const noexcept { return forces_.dropped(); }

 private:
  struct State {
    std::int64_t arrived_ns = 0;
    hapticd_msg_DeviceState message{};
  };
  struct Force {
    std::int64_t arrived_ns = 0;
    hapticd_msg_ForceCommand message{};
  };
  void receive_states() noexcept;
  void receive_forces() noexcept;
  const State* state_of(const hapticd_msg_ForceCommand& force) const;
  ForceRecord record_of(const Force& force);

  const std::uint32_t device_id_;
  SpscQueue<State> states_{8192};
  SpscQueue<Force> forces_{8192};
  std::array<State, 1024> state_{};  // the newest
  std::size_t remembered_ = 0;       // states so far
  std::uint64_t answered_ = 0;       // the newest state that a force answered
  std::uint64_t without_pose_ = 0;
  Reader<hapticd_msg_ServerStatus> status_;
  Reader<hapticd_msg_DeviceState> state_reader_;
  Reader<hapticd_msg_ForceCommand> force_reader_;
};

// A status as a recording keeps it (diagnostics.h).
Diagnostic diagnostic_of(const hapticd_msg_ServerStatus& status, std::int64_t time_ns);

}  // namespace hapticd
