// One device's ticks as the messages of a rosbag2 recording (bag_writer.h), the same that its ROS 2 mirror
// sends.
//
//   /haptic/<id>/pose      PoseStamped      each tick that a new valid state came with, device frame
//   /haptic/<id>/wrench    WrenchStamped    each tick, on the device, device frame
//   /haptic/<id>/buttons   Joy              when they change, and at the first pose
//   /diagnostics           DiagnosticArray  as given
//
// The bag's own timestamp of all messages of a tick is the tick's time, so that pose and wrench of one tick
// find each other; in the header a pose has its client's own time (client_clock.h). frame_id: "haptic_<id>".
// Times: CLOCK_MONOTONIC plus an offset that stays what it was at the beginning: stamps are ns since 1970,
// and a wall clock that is set meanwhile bends none of them. Thread safety: one thread. Errors: the
// constructor throws InputError; after that, see bag_writer.h.
#pragma once

#include "haptic/loop.h"
#include "server/record/bag_writer.h"
#include "server/record/client_clock.h"
#include "server/record/ros2_messages.h"

namespace hapticd {

class DeviceBag {
 public:
  // offset_ns: what turns the records' times into ns since 1970.
  DeviceBag(const std::filesystem::path& directory, std::uint32_t device_id, std::int64_t offset_ns);

  void note(const ForceRecord& record) noexcept;
  void note(const Diagnostic& diagnostic) noexcept;
  void commit() noexcept { bag_.commit(); }
  void close() noexcept { bag_.close(); }
  const BagWriter& bag() const noexcept { return bag_; }

 private:
  const std::int64_t offset_ns_;
  const std::string hardware_;
  Stamp stamp_;
  ClientClock client_;
  CdrWriter cdr_;
  BagWriter bag_;
  int pose_, wrench_, joy_, diagnostics_;
  bool began_ = false;
  std::uint32_t buttons_ = 0;
};

// CLOCK_REALTIME less CLOCK_MONOTONIC, now.
std::int64_t realtime_offset_ns() noexcept;

}  // namespace hapticd
