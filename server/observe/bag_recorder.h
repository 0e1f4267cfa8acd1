// A recording on a thread of its own: queues take what others hand over, the disk makes nobody wait.
//
//   haptic thread → SpscQueue → diagnostics thread → SpscQueue → recorder thread → DeviceBag, a commit a
//   second
//
// A disk that is slow for longer than the queue holds (16 s of ticks) costs ticks, one that is full or gone
// ends the recording: either is counted in `lost` [messages; ticks that the queue refused count as one], the
// second is said once on stderr. A process that is killed loses the last second. Thread safety: push belongs
// to one thread, stop and the constructor to one; the counts may be read by any. Guarantee: push is
// wait-free; of a ForceRecord it allocates nothing. Errors: the constructor throws InputError (device_bag.h).
#pragma once

#include <atomic>
#include <thread>

#include "haptic/spsc_queue.h"
#include "server/record/device_bag.h"

namespace hapticd {

class BagRecorder {
 public:
  BagRecorder(const std::filesystem::path& directory, std::uint32_t device_id);
  ~BagRecorder();
  BagRecorder(const BagRecorder&) = delete;
  BagRecorder& operator=(const BagRecorder&) = delete;

  void push(const ForceRecord& record) noexcept { ticks_.push(record); }
  void push(const Diagnostic& diagnostic) { diagnostics_.push(diagnostic); }
  // Writes what was pushed, and closes. Idempotent.
  void stop() noexcept;

  std::uint64_t kept() const noexcept { return kept_.load(std::memory_order_relaxed); }
  std::uint64_t lost() const noexcept {
    return lost_.load(std::memory_order_relaxed) + ticks_.dropped() + diagnostics_.dropped();
  }
  bool failed() const noexcept { return failed_.load(std::memory_order_relaxed); }

 private:
  void run() noexcept;
  void drain() noexcept;
  void count() noexcept;

  DeviceBag bag_;
  SpscQueue<ForceRecord> ticks_;
  SpscQueue<Diagnostic> diagnostics_;
  std::atomic<std::uint64_t> kept_{0}, lost_{0};
  std::atomic<bool> failed_{false};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace hapticd
