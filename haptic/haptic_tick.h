// What the devices of one world do in one tick, without thread or clock: the live loop and virtual time both
// call it.
//
//   retuned limits → newest published problem → haptic_step → the instruments that the simulation is told of
//
// The loop (loop.h), a virtual daemon (server/schedule/virtual_daemon.h) and a replayed schedule differ in
// where a tick's input comes from, and in nothing else. The problem in use is the channel's newest at the
// tick. Units: as haptic_step.h. Thread safety: one thread, the only reader of `problems`. Guarantee:
// noexcept, no allocation, wait-free.
#pragma once

#include <memory>
#include <vector>

#include "haptic/channel.h"
#include "haptic/haptic_step.h"
#include "haptic/tuning.h"

namespace hapticd {

class HapticTick {
 public:
  // devices: one an instrument, in their order. Everything referred to must outlive the object. Throws
  // std::bad_alloc, and std::invalid_argument where there are not as many devices as instruments.
  HapticTick(Instruments instruments, std::vector<DeviceSettings> devices, const HapticOptions& options,
             Channel<CondensedProblem>& problems);
  HapticTick(Instruments instruments, const DeviceSettings& one, const HapticOptions& options,
             Channel<CondensedProblem>& problems)
      : HapticTick(instruments, std::vector<DeviceSettings>{one}, options, problems) {}

  // From the next tick on the device goes over to these within a second.
  void retune(int device, const DeviceTuning& tuning) noexcept { start_ramp(ramp_[device], tuning); }

  // problem taken into use: none while the simulation is exchanged (withheld): forces go to zero as where
  // problems are lost.
  EachInstrument<ForceSample> run(const HapticInput& input, bool withheld = false) noexcept;

  // Before the first run: clients, arming, counts, limits, scales and the force to go on from are those of a
  // tick that ends here and was withheld. Pre: as many devices, in the same order.
  void take_over(const HapticTick& from) noexcept;

  // After the tick at `now_ns`: what the simulation is told. Of several instruments one whose device renders
  // no force is not there, or tissue would be pressed in the simulation that nobody presses in the tick.
  InstrumentInput instrument(int device, std::int64_t now_ns) const noexcept;
  InstrumentInputs instruments(std::int64_t now_ns) const noexcept;

  // Takes what was published since. What the last solve was of stays as it is.
  const CondensedProblem* newest() noexcept;

  // The problem of the last tick; null: none was published yet.
  const CondensedProblem* problem() const noexcept {
    return problems_.front().step > 0 ? &problems_.front() : nullptr;
  }
  int device_count() const noexcept { return static_cast<int>(devices_.size()); }
  const DeviceSettings& device(int i = 0) const noexcept { return devices_[static_cast<std::size_t>(i)]; }
  const HapticOptions& options() const noexcept { return options_; }
  const HapticState& state() const noexcept { return *state_; }

 private:
  const Instruments instruments_;
  std::vector<DeviceSettings> devices_;
  const HapticOptions options_;
  Channel<CondensedProblem>& problems_;
  EachInstrument<TuningRamp> ramp_;
  std::unique_ptr<HapticState> state_;
  std::unique_ptr<CondensedProblem> kept_;  // what the last solve was of, if that is not the newest
};

}  // namespace hapticd
