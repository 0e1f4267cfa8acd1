// The device port over DDS: one device id, one client at a time.
//
// Who is the client: the writer whose sample comes first is pinned by its publication handle. Samples
// of other writers with the same device id are refused and reported as a conflict; they change
// nothing for the first. The pin ends when that writer disposes, unregisters or is unmatched, and
// when it is silent for 500 ms (a killed process disposes nothing, its lease lasts 10 s; a starved one is
// disarmed after 100 ms, but keeps its device against whoever is heard meanwhile); the next
// writer heard is then a new client. The same writer coming back is not new: it has to show
// enable false → true to be armed again.
// Refused already by a filter in Cyclone's receive thread, before a sample is kept: what is for another
// device or from a stranger while the client is heard. Neither can displace the client's states, or keep the
// loop busy. received_ns: the client's send time, as DDS stamps it, moved into the interval between the
// previous take and this one: right to microseconds on one machine, and never beyond one tick elsewhere.
//
// A second daemon for the device, or whoever writes its forces besides us, is heard by a reader of our own
// force topic (force_reader.h). For the first half second that the port is taken from, it says that it has
// not listened for long enough (Presence::settled): of two daemons started at once both hear the other
// before either arms.
//
// await: a listener in Cyclone's receive thread stamps each arrival and wakes the loop by a futex; an alarm
// rings it when the time has come (wakeup_timer.h: the wait's own time-out would cost the answer 8 µs). Both
// are there only where `events` says so: the fixed tick has no use for them. The alarm's thread has the
// loop's priority where it may.
//
// Thread safety: one thread, the haptic loop's. Guarantee: take and write allocate nothing after the first
// few samples; Cyclone's own locks are held for microseconds by its receive thread, which should therefore
// run in real time too (dds.h, loopback_realtime).
#pragma once

#include <optional>

#include "haptic/loop.h"
#include "server/dds/dds.h"
#include "server/dds/force_reader.h"
#include "server/os/wakeup_timer.h"

namespace hapticd {

DeviceSample sample_from(const hapticd_msg_DeviceState& message) noexcept;
hapticd_msg_ForceCommand message_from(std::uint32_t device_id, const ForceSample& force) noexcept;

class DdsDevicePort final : public DevicePort {
 public:
  // core: the alarm's; none: any.
  DdsDevicePort(const Participant& participant, std::uint32_t device_id, bool events = false,
                std::optional<int> core = {});
  ~DdsDevicePort() override;

  bool take(std::int64_t now_ns, DeviceSample& sample) noexcept override;
  std::int64_t await(std::int64_t until_ns) noexcept override;
  Presence presence() const noexcept override { return presence_; }
  void write(const ForceSample& force) noexcept override;

  // Forces for this device that somebody else wrote, so far. Any thread.
  std::uint64_t foreign_forces() const noexcept { return others_.strange_forces(); }

 private:
  static constexpr std::size_t batch = 32;

  static_assert(std::atomic<std::uint32_t>::is_always_lock_free);

  void arrived() noexcept;
  void wake() noexcept;
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
  int writers_ = 0;            // matched, of any device id
  bool alone_ = false;         // the only one since before the last take
  std::int64_t heard_ns_ = 0;  // from the client
  std::int64_t last_take_ns_ = 0;
  std::int64_t first_take_ns_ = 0;  // 0: none yet
  Presence presence_;
  std::uint32_t seen_ = 0;                              // arrivals before the last take
  alignas(64) std::atomic<std::uint32_t> arrivals_{0};  // written by the receive thread
  std::atomic<std::int64_t> arrived_ns_{0};             // the first of those not taken
  std::atomic<std::uint32_t> taken_{0};                 // seen_, as told to the receive thread
  std::atomic<std::uint32_t> bell_{0};                  // rung by each arrival and by the alarm
  std::optional<WakeupTimer> wakeup_timer_;
};

}  // namespace hapticd
