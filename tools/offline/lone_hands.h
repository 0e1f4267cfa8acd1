// What several hands in one tissue get without a joint solve: a haptic tick for each instrument alone, in
// which the other instruments' contact forces stand still until the next problem.
//
//   x_free,i = x_free + C_pp Σ_{j ≠ i} f_j,   f_j = Σ Hᵀ λ of instrument j in the simulation's last step
//
// The baseline that the daemon's joint solve is charted against. All else of a tick is the daemon's
// (haptic_tick.h). Forces are found again in a new patch by their samples. Instruments do not touch one
// another here. Units: m, N.
#pragma once

#include <memory>
#include <vector>

#include "haptic/haptic_tick.h"

namespace hapticd {

class LoneHands {
 public:
  // What is referred to must outlive the object.
  LoneHands(Instruments instruments, const std::vector<DeviceSettings>& devices,
            const HapticOptions& options);

  // A problem comes into use. step: rows and λ of the simulation's last contact solve.
  void publish(const CondensedProblem& problem, const ContactScratch& step);

  EachInstrument<ForceSample> tick(const HapticInput& input);

 private:
  struct Hand {
    Channel<CondensedProblem> problems;
    std::unique_ptr<HapticTick> tick;
  };

  std::vector<std::unique_ptr<Hand>> hands_;
};

}  // namespace hapticd
