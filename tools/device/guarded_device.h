// Between the driver library and a maker's device: force only while everything keeps its time.
//
//   the pose is older than 5 ms             motors off, zero, `enable` false; 0.5 s: the device is lost
//   a force is on and none was written      motors off, from another thread, while the driver's may hang in
//     for 7 ms                                a call of the maker's library; 2 s: the process ends
//   the maker switched the motors off       zero, `enable` false
//   the dead man's button is let go         `enable` false; the daemon goes to zero within the slew limit
//
// 100 ms after the start, and after the last of the first three, the motors go on, at zero; then `enable` is
// what it was, and the daemon arms and ramps. Threads: as HapticDevice; one thread of its own watches. Guarantee: no
// allocation, no lock between two slots.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>

#include "tools/device/vendor_device.h"

namespace hapticd {

struct GuardSettings {
  unsigned dead_man = 0;  // 1: the maker's first button must be held for force, 2: the second …; 0: none
};

struct GuardReport {
  std::uint64_t stale = 0, hung = 0, switched_off = 0;  // how often each held the force at zero
};

class GuardedDevice final : public HapticDevice {
 public:
  GuardedDevice(VendorDevice& device, const GuardSettings& settings);
  ~GuardedDevice() override;  // the motors are off
  GuardedDevice(const GuardedDevice&) = delete;
  GuardedDevice& operator=(const GuardedDevice&) = delete;

  bool read(Reading& reading) override;
  void write(const Feel& feel) override;

  const std::string& fault() const noexcept { return fault_; }  // why `read` returned false
  GuardReport report() const noexcept { return report_; }

 private:
  void hold(std::int64_t now_ns, std::uint64_t& count) noexcept;
  void watch() noexcept;

  VendorDevice& device_;
  const GuardSettings settings_;
  std::string fault_;
  const char* asked_ = "";
  GuardReport report_;
  std::int64_t held_until_ns_ = 0;
  bool holding_ = true;
  std::atomic<std::int64_t> written_ns_{0};  // the last write that ended; 0: none yet
  std::atomic<bool> loaded_{false};          // a force other than zero may be on
  std::atomic<bool> cut_{false};             // by the watching thread, not yet seen by the driver's
  std::atomic<bool> stopping_{false};
  std::thread watch_;
};

}  // namespace hapticd
