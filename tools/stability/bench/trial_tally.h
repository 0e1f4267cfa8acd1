// What every seeded trial counts of its ticks and steps, and the bounds that none may break.
//
//   each tick   force and torque finite, within the device's maximum and slew; of several hands, of each
//   each step   nodes finite and within TissueBounds, and of each piece H − H_before − fᵀΔx ≤ 10⁻⁶ of the
//               largest H, and H after a cut no more above H before it (tissue_watch.h)
//
// `judge` counts, and says which bound was broken; nothing where none was. Units: SI.
#pragma once

#include <optional>
#include <string>

#include "haptic/device.h"
#include "tools/stability/bench/tissue_watch.h"

namespace hapticd {

struct TrialTally {
  std::int64_t ticks = 0, steps = 0, in_contact = 0;
  std::int64_t latched = 0, saturated = 0, solver_caps = 0;  // ticks of a hand
  std::uint32_t status = 0;                                  // every bit that was set
  int removed = 0;
  double force_max = 0, device_max = 0;       // [N]
  double farthest = 0, farthest_allowed = 0;  // [m]
  double fastest = 0, fastest_allowed = 0;    // [m/s]
  double gained = 0, energy = 0;  // by a piece in a step beyond the work done on it; of the largest [J]
  double split = 0;               // by cuts of the mesh [J]
};

std::optional<std::string> judge(const DeviceSettings& device, const ForceSample& answer,
                                 const ForceSample& last, TrialTally& tally);
std::optional<std::string> judge(const TissueExtremes& seen, const TissueBounds& bounds, TrialTally& tally);

void add(const TrialTally& part, TrialTally& sum);

// Of the largest energy that was seen, beside round-off: what may be gained or made [J].
double energy_allowed(double largest);

// "what value unit, allowed …".
std::string said(const char* what, double value, double allowed, const char* unit);

// Who has been disarmed asks again a fifth of a second later, wherever the tip is by then.
inline bool enables(std::int64_t tick, const ForceSample& last) {
  return tick % 200 != 199 || (last.status & (status_disarmed | status_latched)) == 0;
}

}  // namespace hapticd
