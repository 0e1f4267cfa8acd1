// A device on DDS: sends a pose every millisecond and receives the forces.
//
// A run, on one 1 kHz grid of absolute times:
//   arming    the first pose is sent steadily: 50 slots without `enable`, then with it; again each second while
//             it stays disarmed. From the state ages in the answers the client learns its phase against the
//             daemon's tick, and moves its own grid, here alone, so that states leave half a period before it.
//   slots     slot k of the plan at t0 + k ms; a client that wakes too late for a slot skips it (slots.h).
//             Clients with a common start hold their first poses until all of them are armed. With `arm_again`
//             a client that was held up until its device was disarmed, or whose daemon was, sends 50 slots
//             without `enable`, then with.
//   letting go  20 ms of the last pose, 5 ms without `enable`, then the state is disposed of.
// State numbers begin at the client's monotonic milliseconds and rise by one per slot, so that a client that is
// started again never counts backwards. Forces are taken from the first daemon heard (server/dds/force_reader.h);
// `second_daemon` tells of another.
//
// Threads: `run` starts one sender (SCHED_FIFO where permitted; `grant` says) and returns when it has ended;
// forces are taken in Cyclone's receive thread as they come, so a round trip is timed at arrival. The sender
// asks the source for each pose; source and sender share a thread.
// Errors: std::runtime_error when no daemon answers in time, when it does not arm, or when it falls silent for
// 2 s. After `interrupted()` (interrupt.h) a run ends early, letting go first.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "haptic/channel.h"
#include "haptic/device.h"
#include "server/dds/dds.h"
#include "server/dds/force_reader.h"
#include "server/os/realtime.h"
#include "tools/client/common_start.h"
#include "tools/client/slots.h"

namespace hapticd {

struct ClientSettings {
  std::uint32_t domain = 0;
  std::optional<Security> security;
  std::uint32_t device_id = 0;
  bool enable = true;         // ask for force
  int fifo_priority = 50;     // below the daemon's loop (80) and Cyclone's threads (70, 60)
  double match_timeout = 10;  // [s]
  double arm_timeout = 10;    // [s]
  CommonStart* start = nullptr;  // with other clients, which it outlives
  // Ask for force again after the machine held this client or the daemon up until the device was disarmed.
  // For motions that nobody's hand follows.
  bool arm_again = false;
};

// The device's state in one slot, in the device frame [m].
struct DeviceCommand {
  Pose pose;
  std::uint32_t buttons = 0;
};

// The newest force there is for a device that acts on it.
struct NewestForce {
  Vec3 force = Vec3::Zero();    // [N]
  std::int64_t arrived_ns = 0;  // 0: none yet
};

class SlotSource {
 public:
  virtual ~SlotSource() = default;
  // Held while arming.
  virtual DeviceCommand first() const noexcept = 0;
  // Slot k, at `now`; `fresh`: a force came since the slot before. Called in rising k, not for skipped slots.
  virtual DeviceCommand at(std::int64_t k, std::int64_t now_ns, const NewestForce& newest,
                           bool fresh) noexcept = 0;
};

class DeviceClient {
 public:
  // Reserves everything for `slots`.
  DeviceClient(const Participant& participant, const ClientSettings& settings, std::int64_t slots);
  ~DeviceClient();
  DeviceClient(const DeviceClient&) = delete;
  DeviceClient& operator=(const DeviceClient&) = delete;

  // `poll` is called about 50 times a second on the calling thread, with the slot reached (−1: arming).
  // What it throws ends the run, letting go first.
  void run(SlotSource& source, const std::function<void(std::int64_t)>& poll);

  // Ends a run early, letting go first; any thread.
  void leave() noexcept { leaving_.store(true, std::memory_order_relaxed); }

  // After run.
  const SlotBook& book() const noexcept { return book_; }
  const hapticd_msg_ForceCommand& answer(std::int64_t k) const noexcept { return answers_[std::size_t(k)]; }
  const DeviceCommand& command(std::int64_t k) const noexcept { return commands_[std::size_t(k)]; }
  std::uint32_t status_seen() const noexcept { return status_seen_.load(); }  // all bits during the slots
  const Grant& grant() const noexcept { return grant_; }
  double phase_shift_us() const noexcept { return phase_shift_us_; }
  // Somebody besides the daemon, or a second one, wrote forces for this device.
  bool second_daemon() const noexcept { return reader_.strange_forces() > 0 || status_seen() & status_rival; }
  bool complete() const noexcept { return complete_; }  // neither interrupted nor left
  int armed_again() const noexcept { return armed_again_; }

  // Any time.
  std::uint32_t device_id() const noexcept { return settings_.device_id; }
  double newest_force() const noexcept { return newest_force_.load(std::memory_order_relaxed); }  // [N]

 private:
  enum class Stage { arming, slots, letting_go, ended, no_answer, not_armed, silent };

  bool over() const noexcept;
  void wait_for_daemon();
  void receive() noexcept;
  void count(const hapticd_msg_ForceCommand& force, std::int64_t now_ns) noexcept;
  void send(const DeviceCommand& command, std::uint64_t number, bool enable) noexcept;
  void sender(SlotSource& source) noexcept;
  bool arm(const DeviceCommand& first) noexcept;
  bool due(bool ready) noexcept;
  std::int64_t plan_begin() const noexcept;
  void serve(SlotSource& source) noexcept;
  bool enables(std::int64_t now_ns) noexcept;
  void let_go(const DeviceCommand& last) noexcept;
  void check_end() const;

  ClientSettings settings_;
  SlotBook book_;
  std::vector<hapticd_msg_ForceCommand> answers_;  // receive thread's until the end
  std::vector<DeviceCommand> commands_;            // sender's until the end

  std::atomic<Stage> stage_{Stage::arming};
  std::atomic<bool> leaving_{false};
  std::atomic<bool> counting_{false};  // the plan stands: the book may be asked
  std::atomic<std::uint32_t> status_seen_{0}, status_{status_disarmed};
  std::atomic<std::int64_t> heard_ns_{0}, reached_{-1};
  std::atomic<double> newest_force_{0};
  Channel<NewestForce> newest_;

  // Ages of the states answered since state number `ages_since_`, while arming.
  static constexpr std::size_t age_count = 200;
  std::array<float, age_count> ages_{};
  std::atomic<std::size_t> ages_taken_{0};
  std::atomic<std::uint64_t> ages_since_{~std::uint64_t{0}};
  std::uint64_t last_echo_ = 0;

  std::int64_t next_ns_ = 0;  // sender's grid
  std::uint64_t number_ = 0;
  bool arrived_ = false;  // at the common start
  // Of arming again: the daemon said that it slept itself; when a state was last sent, until when a disarmed
  // device is by either's silence, and until when no force is asked for.
  std::atomic<bool> gap_{false};
  std::int64_t sent_ns_ = 0, held_up_until_ns_ = 0, edge_until_ns_ = 0;
  int armed_again_ = 0;
  double phase_shift_us_ = 0;
  Grant grant_;
  bool complete_ = false;

  Writer<hapticd_msg_DeviceState> writer_;
  ForceReader reader_;  // last: its listener uses all of the above
};

// "ramping_up, saturated" for the bits of a status; "none" for 0.
std::string status_text(std::uint32_t status);

}  // namespace hapticd
