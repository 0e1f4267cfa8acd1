#include "haptic/haptic_tick.h"

#include <stdexcept>
#include <utility>

namespace hapticd {

HapticTick::HapticTick(Instruments instruments, std::vector<DeviceSettings> devices,
                       const HapticOptions& options, Channel<CondensedProblem>& problems)
    : instruments_(instruments),
      devices_(std::move(devices)),
      options_(options),
      problems_(problems),
      state_(std::make_unique<HapticState>()),
      kept_(std::make_unique<CondensedProblem>()) {
  if (device_count() != instruments_.count() || instruments_.count() > max_instruments)
    throw std::invalid_argument("each instrument has a device of its own");
}

void HapticTick::take_over(const HapticTick& from) noexcept {
  state_->device = from.state_->device;
  state_->caps = from.state_->caps;
  state_->tick = from.state_->tick;
  ramp_ = from.ramp_;
  for (int i = 0; i < device_count(); ++i)
    apply(tuning_of(from.device(i)), devices_[static_cast<std::size_t>(i)]);
}

EachInstrument<ForceSample> HapticTick::run(const HapticInput& input, bool withheld) noexcept {
  const std::int64_t period = input.period_ns > 0 ? input.period_ns : options_.watchdog.period_ns;
  for (int i = 0; i < device_count(); ++i)
    advance(ramp_[i], devices_[static_cast<std::size_t>(i)], 1e-9 * static_cast<double>(period));
  newest();
  return haptic_step(withheld ? nullptr : problem(), instruments_, devices_, options_, input, *state_);
}

const CondensedProblem* HapticTick::newest() noexcept {
  if (state_->patch.problem.lender == &problems_.front())
    problems_.acquire(kept_);
  else
    problems_.acquire();
  return problem();
}

InstrumentInput HapticTick::instrument(int i, std::int64_t now_ns) const noexcept {
  const DeviceState& d = state_->device[i];
  InstrumentInput in = instrument_input(device(i), options_.watchdog, d.watchdog, now_ns);
  in.vacuum = in.present ? d.vacuum : 0;
  if (device_count() > 1 && d.render == Render::zero) {
    in.present = false;
    in.buttons = 0;
    in.vacuum = 0;
  }
  return in;
}

InstrumentInputs HapticTick::instruments(std::int64_t now_ns) const noexcept {
  InstrumentInputs all;
  for (int i = 0; i < device_count(); ++i) all[i] = instrument(i, now_ns);
  return all;
}

}  // namespace hapticd
