// The stiffness mode over DDS: `haptic hand` on a running daemon, beside the same press offline.
//
// The cube scene's daemon is started for each stiffness with the widest limits that a device may have. Time
// is the machine's here, so figures vary; a pair of processes, a network and a scheduler are in the loop.
// Judged as offline: swing at rest, and energy made at the device's port less what the device's own damping
// takes (hand_model.h reports the first part alone, so passive here is the stricter).
// Errors: std::runtime_error when a daemon does not start.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

namespace hapticd {

struct DdsPress {
  double force_scale = 0;
  double displayed = 0;  // of the same press offline [N/m]; 0: not sound there
  bool ran = false;      // the daemon armed and answered nine states of ten
  double swing = 0;      // over DDS [m]
  double made = 0;       // over DDS: −least of −∫ F·v dt [J]
  double offline_swing = 0, offline_made = 0;
  double round_trip_p99_us = 0, round_trip_max_us = 0;
  double unanswered = 0;     // share of the slots
  std::uint32_t status = 0;  // bits after arming: a press that was interrupted swings for that alone
};

std::vector<DdsPress> press_over_dds(bool quick, const std::function<bool(double)>& progress);

}  // namespace hapticd
