// The simulation step of a lens under a travelling tip, part by part, over size, model and compliance.
//
// Each step is the daemon's (server/app/simulation_loop.h), on its core and at its priority: adopt the bases
// that are ready, World::step, ask for the bases that are wanted. It is timed as the daemon times it, by the
// wall clock. Methods that keep bases run at the daemon's cadence, a 50 Hz grid, and another thread makes the
// bases; the others run one step after another. `busy`: an ordinary program computes on that core throughout.
// There is no haptic loop beside it. Friction is 0.1, geometry renewed. Contacts are samples within the
// margin, of friction each: three rows of W. Instead of the tip, a blade can be drawn through the lens
// (drawn_blade.h): then only steps in which it cuts are counted. Parts are physics/part_times.h's. Units in
// the names.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "physics/compliance/compliance.h"
#include "physics/part_times.h"
#include "physics/types.h"

namespace hapticd {

struct StepLens {
  std::string name;       // tools/chart/step/travelling_tip.h
  double alarm_distance;  // [m], for about 60 patch nodes
  double sample_spacing;  // [m], for about ten contacts
};
// Smallest first.
const std::vector<StepLens>& step_lenses();

struct StepCase {
  StepLens lens;
  bool corotational = true;
  ComplianceMethod method = ComplianceMethod::exact;
  double removals_per_s = 0;
  double cut_depth = 0;  // of a blade at 10 mm/s in place of the tip [m]
  int steps = 500;
  double seconds = 60;  // a slow case ends here, after ten steps at least
  bool busy = false;
  double speed = 3e-3;  // of the tip [m/s]
  // Of the tissue, what is nearer than that to the tip is simulated, the rest condensed
  // (physics/simulation/region); 0: all is simulated [mean edges of the mesh].
  double near = 0;
  double start_seconds = 6;  // for what is far from regions, before the first step
};

using StepParts = std::array<double, step_parts>;

struct StepPoint {
  std::string model, compliance;
  int nodes = 0, tets = 0;
  int patch_nodes = 0;  // median
  int contacts = 0;     // median: rows, three with friction
  int active = 0;       // … of them with a force, median
  int removed = 0;
  int split_steps = 0;  // in which the mesh was cut
  int nodes_added = 0;  // by cuts
  bool busy = false;
  double speed = 0;  // [m/s]
  double near = 0;   // [mean edges]
  double near_mm = 0;
  int simulated = 0;                                   // nodes
  int boundary = 0;                                    // … at which condensed tissue begins
  double start_ms = 0;                                 // of world and first step
  double memory_mb = 0;                                // of factor and condensed tissue
  std::vector<Vec3> force;                             // on the tip, each step [N]
  std::optional<double> force_rms_rel, force_max_rel;  // against `near` 0, the same case, of its peak
  int bases = 0;
  double reference_ms_median = 0;  // on the other thread
  int late_references = 0;         // steps with patch nodes outside the zone
  int fallback_steps = 0;          // … of condensed tissue
  int regions_entered = 0;
  int threads = 1;  // that the simulation had: its own, and those that make for it
  int steps = 0;
  double step_ms_median = 0, step_ms_p99 = 0, step_ms_max = 0;
  double over_20ms = 0;  // share of the steps
  StepParts parts_ms{};  // means
  double mean_ms = 0;
  bool fits_50hz = false;  // at most 0.5 % of the steps over 20 ms
};

const char* name_of(StepPart part) noexcept;
const char* name_of(ComplianceMethod method) noexcept;

// False ends the run; the point then has what there is.
StepPoint chart_step(const StepCase& of, const std::function<bool(double)>& progress);

// force_rms_rel and force_max_rel of those with condensed tissue that have their like without among them.
void compare_forces(std::span<StepPoint> points);

// e of t ~ nodes^e, least squares of logarithms; nothing from fewer than two sizes, or where a part takes
// less than 10 µs. near, speed: of the points that have these.
std::optional<double> growth(std::span<const StepPoint> points, const std::string& model,
                             const std::string& compliance, double near, double speed,
                             const std::function<double(const StepPoint&)>& ms);

}  // namespace hapticd
