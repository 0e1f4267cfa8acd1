// What one device does in one tick, without thread or clock: the live loop and virtual time both call it.
//
//   retuned limits → newest published problem → haptic_step → the instrument that the simulation is told of
//
// The loop (loop.h), a virtual daemon (server/schedule/virtual_daemon.h) and a replayed schedule differ in
// where a tick's input comes from, and in nothing else. The problem in use is the channel's newest at the
// tick. Units: as haptic_step.h. Thread safety: one thread, the only reader of `problems`. Guarantee:
// noexcept, no allocation, wait-free.
#pragma once

#include <memory>

#include "haptic/channel.h"
#include "haptic/haptic_step.h"
#include "haptic/tuning.h"

namespace hapticd {

class HapticTick {
 public:
  // Everything referred to must outlive the object. Throws std::bad_alloc.
  HapticTick(const Instrument& instrument, const DeviceSettings& device, const HapticOptions& options,
             Channel<CondensedProblem>& problems);

  // From the next tick on the device goes over to these within a second.
  void retune(const DeviceTuning& tuning) noexcept { start_ramp(ramp_, tuning); }

  ForceSample run(const HapticInput& input) noexcept;

  // After the tick at `now_ns`: what the simulation is told.
  InstrumentInput instrument(std::int64_t now_ns) const noexcept {
    return instrument_input(device_, options_.watchdog, state_->watchdog, now_ns);
  }

  // The problem of the last tick; null: none was published yet.
  const CondensedProblem* problem() const noexcept {
    return problems_.front().step > 0 ? &problems_.front() : nullptr;
  }
  const DeviceSettings& device() const noexcept { return device_; }
  const HapticOptions& options() const noexcept { return options_; }
  const HapticState& state() const noexcept { return *state_; }

 private:
  const Instrument& instrument_;
  DeviceSettings device_;
  const HapticOptions options_;
  Channel<CondensedProblem>& problems_;
  TuningRamp ramp_;
  std::unique_ptr<HapticState> state_;
};

}  // namespace hapticd
