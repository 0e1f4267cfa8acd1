// The device port over DDS: one device id, one client at a time.
//
// Who is the client: the writer whose sample comes first is pinned by its publication handle. Samples
// of other writers with the same device id are refused and reported as a conflict; they change
// nothing for the first. The pin ends when that writer disposes, unregisters or is unmatched, and
// when it is silent for 100 ms (a killed process disposes nothing, its lease lasts 10 s); the next
// writer heard is then a new client. The same writer coming back is not new: it has to show
// enable false → true to be armed again.
// received_ns: the client's send time, as DDS stamps it, moved into the interval between the previous
// take and this one: right to microseconds on one machine, and never beyond one tick elsewhere.
// Thread safety: one thread, the haptic loop's. Guarantee: take and write allocate nothing after the
// first few samples; Cyclone's own locks are held for microseconds by its receive thread, which
// should therefore run in real time too (dds.h, loopback_realtime).
#pragma once

#include "haptic/loop.h"
#include "server/dds.h"

namespace hapticd {

DeviceSample sample_from(const hapticd_msg_DeviceState& message) noexcept;
hapticd_msg_ForceCommand message_from(std::uint32_t device_id, const ForceSample& force) noexcept;

class DdsDevicePort final : public DevicePort {
 public:
  DdsDevicePort(const Participant& participant, std::uint32_t device_id);

  bool take(std::int64_t now_ns, DeviceSample& sample) noexcept override;
  Presence presence() const noexcept override { return presence_; }
  void write(const ForceSample& force) noexcept override;

 private:
  static constexpr std::size_t batch = 32;

  dds_instance_handle_t departed() noexcept;
  bool admit(dds_instance_handle_t writer, std::int64_t now_ns) noexcept;

  std::uint32_t device_id_;
  Reader<hapticd_msg_DeviceState> reader_;
  Writer<hapticd_msg_ForceCommand> writer_;
  std::array<hapticd_msg_DeviceState, batch> samples_{};
  std::array<dds_sample_info_t, batch> infos_{};
  dds_instance_handle_t pinned_ = 0;    // the client's writer; 0: none
  dds_instance_handle_t last_pinned_ = 0;
  int writers_ = 0;                     // matched, of any device id
  std::int64_t heard_ns_ = 0;           // from the client
  std::int64_t last_take_ns_ = 0;
  Presence presence_;
};

}  // namespace hapticd
