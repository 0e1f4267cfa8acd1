// The haptic loop: the one thread and the one clock of this folder, for all devices of a world.
//
//   every 1 ms, or for each state that arrives:  take → haptic_step → write → publish the instruments → count
//
// Mode `tick`: the thread wakes `early_ns` before each point of the grid t₀ + k T (clock_nanosleep on
// CLOCK_MONOTONIC) and reads the clock for the rest, so a timer that is late by less makes no tick late. A
// tick that ends after later grid points counts them as missed and goes on at the next one, without catching
// up. A client that sent a state for each of the last ticks is waited for when one is late, at most
// `late_state_ns` from the grid point. A tick that is itself late waits `behind_stall_ns` at least, in the
// first half of a period, because what held it up also held up the client. Wait and three quarters of the
// solve's budget fit in a period.
// Mode `event`: a tick for each arrival at any device, answered at once with the others' newest poses, but at
// least `min_answer_ns` after that device's previous answer and `min_tick_ns` after another's: one that is
// flooded holds up no other. Without arrivals a tick comes 1.5 T after the last arrival's, then each T. A
// tick's intended time is the arrival, or the end of that wait. The step is told the time since the previous
// tick, at most T: limits per second stay limits per second. Latencies count from the intended time.
// Thread safety: start, stop and the constructor belong to one thread; statistics may be read by any; the
// loop's thread alone reads `problems`, writes `instrument_inputs`, pushes to `history` and uses the port.
// Guarantee: between start and stop the thread allocates nothing, takes no lock of its own and logs nothing.
// The port answers for what it does in take and write. Errors: start throws std::runtime_error if it gets no
// thread.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <thread>

#include "haptic/channel.h"
#include "haptic/contact_capture.h"
#include "haptic/haptic_tick.h"
#include "haptic/loop_statistics.h"
#include "haptic/spsc_queue.h"
#include "haptic/tick_record.h"

namespace hapticd {

// The device's side of the loop. All three are called from the loop's thread only.
class DevicePort {
 public:
  virtual ~DevicePort() = default;
  // The newest state since the last call, with received_ns set; false: none came.
  virtual bool take(std::int64_t now_ns, DeviceSample& sample) noexcept = 0;
  // Sleeps until something is there that the next take will look at, of this device or of those it wakes for,
  // and that device's earliest time has come, or until `until_ns`: the later of arrival and earliest time, or
  // 0. Only in mode `event`. May wake without a new state.
  virtual std::int64_t await(std::int64_t until_ns,
                             const EachInstrument<std::int64_t>& earliest_ns) noexcept = 0;
  // As of the last take.
  virtual Presence presence() const noexcept = 0;
  virtual void write(const ForceSample& force) noexcept = 0;
};

enum class LoopMode : std::uint8_t { tick, event };

struct LoopTiming {
  LoopMode mode = LoopMode::tick;
  std::int64_t early_ns = 50'000;          // tick: the thread wakes before a grid point; 0: at it
  std::int64_t min_answer_ns = 500'000;    // event: between two answers of a device
  std::int64_t min_tick_ns = 100'000;      // event: … of two devices
  std::int64_t late_state_ns = 350'000;    // tick: how long a state that is late is waited for; 0: not at all
  std::int64_t behind_stall_ns = 150'000;  // tick: … at least, by a tick that is late itself
};

// One tick for the recording.
struct ForceRecord {
  std::int64_t time_ns = 0;  // intended
  ForceSample force;
  Pose device;  // newest valid state, device frame
  InstrumentInput instrument;
};

// A device as the loop has it.
struct LoopDevice {
  DeviceSettings settings;
  DevicePort& port;
  SpscQueue<ForceRecord>& history;
  Channel<DeviceTuning>* tunings = nullptr;  // new limits and scales, gone over to within a second
};

class HapticLoop {
 public:
  // devices: one an instrument, in their order; in mode `event` the first one's port is waited on, and is to
  // wake for all. Everything referred to must outlive the loop.
  HapticLoop(Instruments instruments, const std::vector<LoopDevice>& devices, const HapticOptions& options,
             Channel<CondensedProblem>& problems, Channel<InstrumentInputs>& instrument_inputs,
             const LoopTiming& timing = {});
  ~HapticLoop();
  HapticLoop(const HapticLoop&) = delete;
  HapticLoop& operator=(const HapticLoop&) = delete;

  // ContactCaptures::into. Before start.
  void capture_into(Channel<ContactCapture>& captures, std::uint64_t every) noexcept {
    captures_.into(captures, every);
  }

  // What the simulation is told is copied there too, for an edge (server/edge). Before start; the channel
  // must outlive the loop.
  void share_into(Channel<InstrumentInputs>& copies) noexcept { copies_ = &copies; }

  // Records what each tick's force came from; what does not fit is dropped and counted by the queue. Before
  // start; the queue must outlive the loop.
  void record_into(SpscQueue<TickRecord>& records);

  // on_thread runs on the new thread before its first tick: the place for priority and affinity.
  void start(std::function<void()> on_thread = {});
  // Returns after the last tick; the last force written is zero and disarmed. Idempotent.
  void stop() noexcept;

  // While the simulation is exchanged, for one thread, between start and stop: no problem is taken, and
  // forces go to zero within the slew limit. at_zero: they are there.
  void withhold(bool on) noexcept { withheld_.store(on, std::memory_order_release); }
  bool at_zero() const noexcept { return at_zero_.load(std::memory_order_acquire); }
  // … the loop goes on with `next`, which takes over clients and arming. Returns what it had, once no tick
  // uses that any more. next: made for the same devices; its settings and problems are used from here on.
  std::unique_ptr<HapticTick> exchange(std::unique_ptr<HapticTick> next);

  const LoopStatistics& statistics(int device = 0) const noexcept { return statistics_[device]; }

 private:
  void run() noexcept;
  void run_on_grid() noexcept;
  void wait_for(std::int64_t intended_ns) noexcept;
  void run_on_arrivals() noexcept;
  void tick(std::int64_t intended_ns) noexcept;
  std::int64_t waits_until(std::int64_t intended_ns, std::int64_t now_ns) const noexcept;
  void take(std::int64_t intended_ns, HapticInput& input) noexcept;
  bool take_all(HapticInput& input, bool first) noexcept;
  void retune() noexcept;
  void take_next() noexcept;
  std::int64_t next_slot(std::int64_t intended_ns) noexcept;
  void count(int device, const ForceSample& force) noexcept;
  void count_page_faults(bool armed) noexcept;

  const HapticOptions& options() const noexcept { return tick_->options(); }
  std::int64_t solve_by_clock(std::int64_t intended, HapticInput& input) noexcept;
  void record(const HapticInput& input) noexcept;

  int devices() const noexcept { return static_cast<int>(devices_.size()); }
  LoopDevice& device(int i) noexcept { return devices_[static_cast<std::size_t>(i)]; }

  std::vector<LoopDevice> devices_;
  std::unique_ptr<HapticTick> tick_;                          // the loop's thread alone uses it
  std::atomic<HapticTick*> next_{nullptr}, former_{nullptr};  // one at a time
  std::atomic<bool> withheld_{false}, at_zero_{false};
  EachInstrument<ForceSample> forces_;  // of the newest tick
  Channel<InstrumentInputs>& instrument_inputs_;
  Channel<InstrumentInputs>* copies_ = nullptr;
  SpscQueue<TickRecord>* records_ = nullptr;
  std::unique_ptr<TickRecord> record_;  // where `records_` is
  ContactCaptures captures_;
  const LoopTiming timing_;
  std::int64_t last_woken_ns_ = 0;
  EachInstrument<int> answered_in_a_row_;  // ticks, as far as it matters
  std::int64_t faults_before_ = -1;        // of this thread when it was first armed; −1: not yet
  EachInstrument<LoopStatistics> statistics_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace hapticd
