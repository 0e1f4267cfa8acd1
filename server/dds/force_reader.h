// One device's forces as its client hears them from one daemon, or as a daemon hears them from anybody else.
//
//   client   the first daemon heard is kept, by its publication handle, until it has been silent for 100 ms;
//            forces of any other are refused and counted
//   daemon   what its own participant writes is not heard; everything else is refused and counted: there is a
//            second daemon for the device, or somebody who plays one
//
// Samples decide, not discovery: a writer that is matched and writes nothing may serve another device, or may
// belong to a daemon that was killed and stays in discovery until its lease ends (10 s).
// What is refused is refused by a filter in Cyclone's receive thread, before a sample is kept: it cannot
// displace a force of the daemon that is kept, however many come. A client that wakes late finds the forces
// of the last eight ticks: each is the answer to a state. Thread safety: take_into for one thread; the rest
// for any. Guarantee: noexcept, wait-free, no allocation after the first samples. Errors: the constructor
// throws std::runtime_error with Cyclone's reason.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

#include "server/dds/dds.h"

namespace hapticd {

// For how long a stranger's last force counts as his being there.
inline constexpr std::int64_t stranger_stays_ns = 500'000'000;
// Of a client's, until it takes them: one a tick, the newest last.
inline constexpr int forces_kept = 8;

class ForceReader {
 public:
  enum class Side : std::uint8_t { client, daemon };

  ForceReader(const Participant& participant, std::uint32_t device_id, Side side);
  ForceReader(const ForceReader&) = delete;
  ForceReader& operator=(const ForceReader&) = delete;

  // As Reader::take_into; forces of this device and this daemon alone.
  template <std::size_t N>
  int take_into(std::array<hapticd_msg_ForceCommand, N>& samples,
                std::array<dds_sample_info_t, N>& infos) noexcept {
    std::array<void*, N> buffer;
    for (std::size_t i = 0; i < N; ++i) buffer[i] = &samples[i];
    return dds_take(entity_.handle(), buffer.data(), infos.data(), N, N);
  }
  // How many writers of forces there are, of any device.
  int matched() const noexcept;

  // Whether a stranger's force for this device came within the last half second (monotonic time).
  bool stranger(std::int64_t now_ns) const noexcept;
  std::uint64_t strange_forces() const noexcept { return strange_.load(std::memory_order_relaxed); }

  dds_entity_t handle() const noexcept { return entity_.handle(); }

 private:
  bool wanted(const hapticd_msg_ForceCommand& force, dds_instance_handle_t writer) noexcept;

  const std::uint32_t device_id_;
  const Side side_;
  // Written by the receive thread.
  std::atomic<dds_instance_handle_t> daemon_{0};
  std::atomic<std::int64_t> heard_ns_{0};
  std::atomic<std::int64_t> stranger_ns_{0};  // 0: never
  std::atomic<std::uint64_t> strange_{0};
  DdsEntity topic_;
  DdsEntity entity_;
};

}  // namespace hapticd
