#include "haptic/haptic_tick.h"

namespace hapticd {

HapticTick::HapticTick(const Instrument& instrument, const DeviceSettings& device,
                       const HapticOptions& options, Channel<CondensedProblem>& problems)
    : instrument_(instrument),
      device_(device),
      options_(options),
      problems_(problems),
      state_(std::make_unique<HapticState>()) {}

ForceSample HapticTick::run(const HapticInput& input) noexcept {
  const std::int64_t period = input.period_ns > 0 ? input.period_ns : options_.watchdog.period_ns;
  advance(ramp_, device_, 1e-9 * static_cast<double>(period));
  problems_.acquire();
  return haptic_step(problem(), instrument_, device_, options_, input, *state_);
}

}  // namespace hapticd
