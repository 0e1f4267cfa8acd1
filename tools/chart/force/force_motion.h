// Which motion of the instrument a chart of forces runs along: a recording laid into the scene, and a window
// of it.
//
// The scene's own trajectory is mapped as the daemon maps it. Any other recording is fitted: its positions
// are scaled by the scene's position scale, by less if it then ranged farther than `reach` from its middle
// sideways; its mean orientation becomes the instrument's upright; its middle lies above the middle of the
// tissue's highest place, so high that the instrument overlaps the tissue at rest by `depth` at most. The
// window begins `lead` before the instrument first comes to overlap the tissue at rest. Of a recording that
// never leaves it the window begins where the recording does, and the instrument comes down to there first
// (OfflineInput::approach). Units: m, s. Errors:
// InputError for a recording that never comes near (the scene's own).
#pragma once

#include <filesystem>
#include <string>

#include "tools/offline/offline_run.h"

namespace hapticd {

struct WindowSettings {
  double length = 0.6;    // [s]
  double lead = 0.02;     // [s]
  double depth = 0.3e-3;  // of a fitted recording [m]
  double reach = 1.5e-3;  // … sideways [m]
};

// Deepest overlap of the instrument at X with the first deformable body at rest [m]; negative: a gap.
double rest_overlap(const Scene& scene, const Pose& X);

OfflineInput motion_in_scene(const Scene& scene, const std::filesystem::path& file,
                             const WindowSettings& settings);

// Part of the scene's own trajectories on their one time axis [s].
struct ForceWindow {
  std::string name;
  double from = 0, to = 0;
  bool removals = false;  // elements go by the instruments' own rules and pedals, and ports draw
  // Bodies begin as the operation left them (operation_history.h), so long before `from` as runs settle, or
  // where the trajectories begin; runs then follow them to `from` instead of holding the first poses.
  bool history = false;
};

// Each instrument along its own trajectory, mapped as the daemon maps it; without a history one that overlaps
// the tissue at rest where the window begins comes down to there first. Errors: InputError for an instrument
// without a trajectory, or where one does not cover the window.
OfflineInput motions_in_window(const Scene& scene, const ForceWindow& window);

}  // namespace hapticd
