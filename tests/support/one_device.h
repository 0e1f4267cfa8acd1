// A tick of a world with one instrument and one device, as most tests have it.
#pragma once

#include "haptic/haptic_step.h"

namespace hapticd {

inline ForceSample haptic_step(const CondensedProblem* problem, const Instrument& instrument,
                               const DeviceSettings& device, const HapticOptions& options,
                               const HapticInput& input, HapticState& state) noexcept {
  return haptic_step(problem, Instruments(instrument), std::span(&device, 1), options, input, state)[0];
}

}  // namespace hapticd
