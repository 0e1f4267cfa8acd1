// The haptic loop: the one thread and the one clock of this folder.
//
//   every 1 ms:  take → haptic_step → write → publish the instrument → count
//
// Time: clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME) on the grid t₀ + k T. A tick that ends after
// later grid points leaves them out (they are counted as missed) and goes on at the next one: no
// catch-up bursts. All latencies count from the grid point.
// Thread safety: start, stop and the constructor belong to one thread; statistics may be read by any;
// the loop's thread alone reads `problems`, writes `instrument`, pushes to `history` and uses the port.
// Guarantee: between start and stop the thread allocates nothing, takes no lock of its own and logs
// nothing; what the port does in take and write is the port's to answer for.
// Errors: start throws std::runtime_error when no thread can be made.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <thread>

#include "haptic/channel.h"
#include "haptic/contact_capture.h"
#include "haptic/haptic_step.h"
#include "haptic/loop_statistics.h"
#include "haptic/spsc_queue.h"

namespace hapticd {

std::int64_t monotonic_ns() noexcept;  // CLOCK_MONOTONIC

// The device's side of the loop. All three are called from the loop's thread only.
class DevicePort {
 public:
  virtual ~DevicePort() = default;
  // The newest state since the last call, with received_ns set; false: none came.
  virtual bool take(std::int64_t now_ns, DeviceSample& sample) noexcept = 0;
  // As of the last take.
  virtual Presence presence() const noexcept = 0;
  virtual void write(const ForceSample& force) noexcept = 0;
};

// One tick for the recording.
struct ForceRecord {
  std::int64_t time_ns = 0;  // intended
  ForceSample force;
  Pose device;               // newest valid state, device frame
  InstrumentInput instrument;
};

class HapticLoop {
 public:
  // Everything referred to must outlive the loop.
  HapticLoop(const Instrument& instrument, const DeviceSettings& device, const HapticOptions& options,
             DevicePort& port, Channel<CondensedProblem>& problems,
             Channel<InstrumentInput>& instrument_inputs, SpscQueue<ForceRecord>& history);
  ~HapticLoop();
  HapticLoop(const HapticLoop&) = delete;
  HapticLoop& operator=(const HapticLoop&) = delete;

  // Captures solves that ended at a cap, and every `every`-th one (0: none else), at most one in 20 ms, each for
  // about 0.1 ms. Before start; the channel must outlive the loop.
  void capture_into(Channel<ContactCapture>& captures, std::uint64_t every);

  // on_thread runs on the new thread before its first tick: the place for priority and affinity.
  void start(std::function<void()> on_thread = {});
  // Returns after the last tick; the last force written is zero and disarmed. Idempotent.
  void stop() noexcept;

  const LoopStatistics& statistics() const noexcept { return statistics_; }

 private:
  void run() noexcept;
  void tick(std::int64_t intended_ns) noexcept;
  std::int64_t next_slot(std::int64_t intended_ns) noexcept;
  void count(const ForceSample& force) noexcept;
  void capture(const CondensedProblem& problem, const ForceSample& force) noexcept;

  const Instrument& instrument_;
  const DeviceSettings device_;
  const HapticOptions options_;
  DevicePort& port_;
  Channel<CondensedProblem>& problems_;
  Channel<InstrumentInput>& instrument_inputs_;
  SpscQueue<ForceRecord>& history_;
  Channel<ContactCapture>* captures_ = nullptr;
  std::uint64_t capture_every_ = 0;
  std::uint64_t solves_ = 0;
  std::uint64_t last_capture_ = 0;  // its tick
  ContactState before_;             // of this tick's solve, where captures are asked for
  std::unique_ptr<HapticState> state_;
  LoopStatistics statistics_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace hapticd
