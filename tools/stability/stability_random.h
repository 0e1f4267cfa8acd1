// A million ticks of chance: a hand that strays through the cataract scene, cuts, and loses states.
//
// Every few tenths of a second the hand heads for another place over, on or up to 1.5 mm in the lens, shaft
// through the incision, pedals up or down; one way in ten loses a burst of states. The device is the scene's
// with its own limits. A fresh lens every `episode` ticks. Deterministic, on however many cores.
#pragma once

#include <cstdint>
#include <functional>

#include "server/scene/scene.h"

namespace hapticd {

struct RandomSettings {
  std::int64_t ticks = 1'000'000;
  std::int64_t episode = 40'000;
  std::uint64_t seed = 1;
  bool passivity_control = false;
};

struct RandomReport {
  bool passivity_control = false;
  std::int64_t ticks = 0, in_contact = 0;
  std::int64_t not_finite = 0;     // ticks with a number that is none, in force or energy
  std::int64_t above_maximum = 0;  // ticks with more than the device's largest force
  std::int64_t latched = 0;        // ticks
  std::int64_t solver_caps = 0, saturated = 0;
  int removed = 0;
  double force_max = 0, device_max = 0;  // [N]
  double made = 0;      // by the renderer: −least of −∫ F·v dt, largest of the episodes' [J]
  double absorbed = 0;  // … at the end, all episodes [J]
  double controlled_force_max = 0;  // the controller's own, on the device [N]
  double controlled_work = 0;       // … what it took out, all episodes [J]
  double controlled_force_rms = 0;  // … over all ticks [N]
  std::uint32_t status = 0;         // every bit that was set
};

// `progress(fraction)` returns false to stop.
RandomReport run_random(const Scene& cataract, const RandomSettings& settings,
                        const std::function<bool(double)>& progress);

}  // namespace hapticd
