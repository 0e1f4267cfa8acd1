// The thread that writes a run's schedule (schedule_file.h), fed by queues that neither loop waits for.
//
// Thread safety: start and stop belong to one thread; the haptic loop's thread pushes to `ticks`, the
// simulation's to `steps`. A record that finds its queue full is lost and counted; so are all after a disk
// that is full. Errors: the constructor throws std::runtime_error naming the file.
#pragma once

#include <atomic>
#include <optional>
#include <thread>

#include "haptic/spsc_queue.h"
#include "server/schedule/schedule_file.h"

namespace hapticd {

class ScheduleRecorder {
 public:
  ScheduleRecorder(const std::filesystem::path& file, const Scene& scene,
                   const std::vector<DeviceSettings>& devices);
  ~ScheduleRecorder();
  ScheduleRecorder(const ScheduleRecorder&) = delete;
  ScheduleRecorder& operator=(const ScheduleRecorder&) = delete;

  // realtime_core: the thread keeps off it.
  void start(std::optional<int> realtime_core = {});
  // After both loops: drains what they left, and ends the file. Idempotent.
  void stop() noexcept;

  SpscQueue<TickRecord>& ticks() noexcept { return ticks_; }
  SpscQueue<StepRecord>& steps() noexcept { return steps_; }

  std::uint64_t recorded() const noexcept { return recorded_.load(std::memory_order_relaxed); }
  std::uint64_t lost() const noexcept {
    return ticks_.dropped() + steps_.dropped() + unwritten_.load(std::memory_order_relaxed);
  }
  bool failed() const noexcept { return failed_.load(std::memory_order_relaxed); }

 private:
  void drain();

  SpscQueue<TickRecord> ticks_;
  SpscQueue<StepRecord> steps_;
  ScheduleWriter writer_;
  TickRecord tick_;  // that is being written
  std::atomic<std::uint64_t> recorded_{0}, unwritten_{0};
  std::atomic<bool> failed_{false}, stopping_{false};
  bool ended_ = false;
  std::thread thread_;
};

}  // namespace hapticd
