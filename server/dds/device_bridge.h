// The device port over DDS: one device id, one client at a time.
//
// The client is the writer whose sample comes first; it is pinned by its publication handle. Samples of other
// writers are refused, reported as a conflict and change nothing. The pin ends when the writer disposes,
// unregisters or is unmatched, or after 500 ms of silence; the next writer heard is a new client. A writer
// that comes back is not new: it has to show enable false → true to be armed again.
// received_ns: the client's send time, as DDS stamps it, moved into the interval between the previous take
// and this one: right to microseconds on one machine, and never beyond one tick elsewhere. A second daemon is
// heard by a reader of our own force topic (force_reader.h). For the first half second the port says that it
// has not listened for long enough (Presence::settled). await: a listener in Cyclone's receive thread stamps
// each arrival and wakes the loop by a futex (the first port's, where a loop has several); a timer wakes it
// at the latest time (wakeup_timer.h). Both exist only with `events`.
//
// Thread safety: one thread, the haptic loop's. Guarantee: take and write allocate nothing after the first
// few samples; Cyclone's own locks are held for microseconds by its receive thread, which should run in real
// time too (dds.h, loopback_realtime).
#pragma once

#include <optional>
#include <vector>

#include "haptic/loop.h"
#include "server/dds/dds.h"
#include "server/dds/force_reader.h"
#include "server/os/wakeup_timer.h"

namespace hapticd {

DeviceSample sample_from(const hapticd_msg_DeviceState& message) noexcept;
hapticd_msg_ForceCommand message_from(std::uint32_t device_id, const ForceSample& force) noexcept;

class DdsDevicePort final : public DevicePort {
 public:
  // core: the alarm's; none: any. leader: with `events`, the port of the same loop that is waited on for
  // both. It outlives this one; nobody waits while this one is made or ends.
  DdsDevicePort(const Participant& participant, std::uint32_t device_id, bool events = false,
                std::optional<int> core = {}, DdsDevicePort* leader = nullptr);
  ~DdsDevicePort() override;

  bool take(std::int64_t now_ns, DeviceSample& sample) noexcept override;
  std::int64_t await(std::int64_t until_ns,
                     const EachInstrument<std::int64_t>& earliest_ns) noexcept override;
  Presence presence() const noexcept override { return presence_; }
  void write(const ForceSample& force) noexcept override;

  // Forces for this device that somebody else wrote, so far. Any thread.
  std::uint64_t foreign_forces() const noexcept { return others_.strange_forces(); }

 private:
  static constexpr std::size_t batch = 32;

  static_assert(std::atomic<std::uint32_t>::is_always_lock_free);

  void arrived() noexcept;
  void wake() noexcept;
  std::int64_t due_ns(std::int64_t earliest_ns) const noexcept;
  bool wanted(const hapticd_msg_DeviceState& state, dds_instance_handle_t writer) noexcept;
  bool matching_changed() const noexcept;  // since `departed` looked
  dds_instance_handle_t departed() noexcept;
  bool admit(dds_instance_handle_t writer, std::int64_t now_ns) noexcept;

  std::uint32_t device_id_;
  // What the receive thread needs for `wanted`, as of the last take; and what it tells the next.
  std::atomic<dds_instance_handle_t> client_{0};
  std::atomic<std::int64_t> client_heard_ns_{0};
  std::atomic<bool> stranger_{false};
  Reader<hapticd_msg_DeviceState> reader_;
  Writer<hapticd_msg_ForceCommand> writer_;
  ForceReader others_;
  std::array<hapticd_msg_DeviceState, batch> samples_{};
  std::array<dds_sample_info_t, batch> infos_{};
  dds_instance_handle_t pinned_ = 0;  // the client's writer; 0: none
  dds_instance_handle_t last_pinned_ = 0;
  int writers_ = 0;                 // matched, of any device id
  bool alone_ = false;              // the only one since before the last take
  std::int64_t heard_ns_ = 0;       // from the client
  std::int64_t last_take_ns_ = 0;   // that looked
  bool heard_of_arrivals_ = false;  // with `events`: where none came there is nothing to take
  std::int64_t first_take_ns_ = 0;  // 0: none yet
  Presence presence_;
  DdsDevicePort* const leader_;  // null: waited on itself
  std::vector<const DdsDevicePort*> followers_;
  std::uint32_t seen_ = 0;                              // arrivals before the last take
  alignas(64) std::atomic<std::uint32_t> arrivals_{0};  // written by the receive thread
  std::atomic<std::int64_t> arrived_ns_{0};             // the first of those not taken
  std::atomic<std::uint32_t> taken_{0};                 // seen_, as told to the receive thread
  std::atomic<std::uint32_t> bell_{0};                  // rung by each arrival and by the alarm
  std::optional<WakeupTimer> wakeup_timer_;
};

}  // namespace hapticd
