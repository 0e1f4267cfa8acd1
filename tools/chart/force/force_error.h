// How far a force is from the reference's, and what of it a hand would feel.
//
//   e(t) = f(t) − f_ref(t),   relative to the peak ‖f_ref‖ of the window
//   swap jump: ‖e(t) − e(t − 1 ms)‖ where a new problem comes into use
//   swap step: ‖f(t) − f(t − 1 ms)‖ there: what a hand feels, right or wrong. The reference has its own, for
//   tissue that goes under load lets the force fall within a millisecond; excess: the step less that, or 0
//   buzz: RMS of e above 30 Hz, by its spectrum under a Hann window
//   onset: when ‖f‖ first passes 5 % of the peak, against the reference's
//
// Forces only; torques have their own RMS. Units: N, s; percentages as ratios.
#pragma once

#include "tools/offline/offline_run.h"

namespace hapticd {

struct ForceError {
  double peak = 0;            // of the reference [N]
  double rms_rel = 0;         // of e, to the reference's peak
  double rms_rel_to_rms = 0;  // … to the reference's RMS
  double max_rel = 0;
  double torque_rms_rel = 0;  // to the reference's peak torque
  double swap_jump_p95_rel = 0;
  double swap_step_p95_rel = 0, reference_step_p95_rel = 0, swap_excess_p95_rel = 0;
  double buzz_rms_n = 0;      // in the scene [N]
  double onset_ms = 0;        // later than the reference: positive
  double penetration_um = 0;  // deepest overlap that a solve left
};

ForceError force_error(const std::vector<OfflineTick>& run, const std::vector<OfflineTick>& reference);

// Of each instrument that the reference has, and the one with the largest RMS of them.
std::vector<ForceError> force_errors(const HandTicks& run, const HandTicks& reference);
ForceError worst(const std::vector<ForceError>& hands);

// One-sided power of the error under a Hann window, all components together, in bins of df.
struct Spectrum {
  double df = 0;              // [Hz]
  std::vector<double> power;  // [N²] per bin: their sum is the mean square of e
};
Spectrum error_spectrum(const std::vector<OfflineTick>& run, const std::vector<OfflineTick>& reference);

// A reference has converged where half its step agrees within 0.5 % of the peak (RMS) and nothing inverts.
inline constexpr double converged_within = 5e-3;

}  // namespace hapticd
