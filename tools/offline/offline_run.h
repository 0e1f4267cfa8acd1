// A scene run offline along motions of its instruments: the daemon in virtual time
// (server/schedule/virtual_daemon.h), a tick each millisecond, with delays that are options.
//
// Nothing depends on the clock: two runs of the same inputs agree bit for bit, costs excepted, as long as
// BLAS has one thread. Delays are inputs because the daemon's are not constant; they are the measured
// medians. Times are seconds of the motions. The first `settle` seconds hold the first poses, or come down to
// them, and are not in the result. Forces are in scene newtons on the instruments, whatever the devices'
// scales; limits (arming ramp, saturation, slew) and the blend at removals are off unless asked for, so that
// errors are the method's. Units: SI. Errors: std::runtime_error from a singular body, std::invalid_argument
// for a rate above 1 kHz.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "physics/simulation/world.h"
#include "server/record/trajectory.h"
#include "server/scene/scene.h"
#include "server/schedule/virtual_link.h"

namespace hapticd {

// Which tetrahedra go when: the same for every configuration and for the reference.
struct RemovalEvent {
  double t = 0;  // for a reference they are gone in the first step that begins then or later; a simulation
                 // step takes what goes until its begin + removal_lead (world_settings.h) [s]
  int body = 0;
  std::vector<int> tets;
  double time = 0;  // > 0: they do not go, but become less from t on, evenly, as if nothing were left so much
                    // later (World::schedule_thinning) [s]
};
using RemovalSchedule = std::vector<RemovalEvent>;  // by time

// What pedals do in a run: nothing; ports draw; or, beside that, elements go by the instruments' own rules.
enum class Pedals { idle, suction, all };

// What is compared along: poses of the instruments in the scene, a window, and removals in it.
struct OfflineInput {
  EachInstrument<Trajectory> motion;  // on one time axis; one without samples is not there
  double from = 0, to = 0;            // [s]
  double settle = 0.1;                // [s]
  // Of a window that begins in contact: in the first 0.6 of settling an instrument comes down to its first
  // pose from so high above it (+z of the scene) [m]. Put there at once, what friction holds is chance.
  EachInstrument<double> approach;
  // The first poses are not held: while settling, motions and removals go on towards the window's begin, for
  // a scene whose bodies begin from a state (operation_history.h). Pumps begin without vacuum.
  bool leads_in = false;
  Pedals pedals = Pedals::idle;
  RemovalSchedule removals;
};

// The scene's own trajectories, as long as all last. Throws InputError naming the scene where an instrument
// has none; why: what it is needed for.
OfflineInput along_trajectories(const Scene& scene, const std::string& why);

// What becomes of a simulation step's problem at 1 kHz.
enum class Rendering {
  solved,           // solved again each millisecond: what the daemon does
  held,             // the step's own force until the next one
  extrapolated,     // … continued by the line through the last two
  spring,           // the deepest sample alone, a spring of its own compliance along its normal, no friction
  frozen_friction,  // normal forces solved each millisecond, the step's friction force held
  alone,  // each instrument solved by itself, the others' forces of the last step held (lone_hands.h)
};

// One configuration. Compliance, contact, rate, friction, linearity and meshes are the scene's.
struct OfflineOptions {
  Rendering rendering = Rendering::solved;
  std::optional<Warping> warping;
  bool newest_pose = true;
  bool fresh_free_motion = true;
  std::optional<double> lead;  // WorldSettings::lead in steps; 0: no look-ahead
  bool viscous = true;         // the haptic tick's patch is viscous on its own time (viscous_patch.h)
  int linearisations = 2;      // of the haptic solve
  double tolerance = 0;        // of the friction solver, in both loops; 0: the scene's
  int sweeps_only = 0;         // > 0: block Gauss-Seidel with so many sweeps instead of the hybrid
  bool limits = false;
  double blend_time = 0;  // after a removal [s]
  // Of a step's begin, at most a period less a tick [s]. Absent: 1 ms where the step looks ahead, 6 ms else,
  // and never before 4 ms in a step that removes something.
  std::optional<double> latch_after;
  double publish_after = 10e-3;                        // … at most a period [s]
  std::optional<double> interim_after = removal_lead;  // …; absent: no interim problems
  // Poses of World::refresh, in periods after a step's begin, later than the step's own problem; in use 2 ms
  // later.
  std::vector<double> refresh_at = {0.6, 0.8};
  double reference_after = 0.04;  // [s]
  // What becomes of a problem on its way to the tick. Absent: nothing.
  std::function<void(CondensedProblem&)> carried = {};
  std::optional<LinkTrouble> link = {};  // between the daemon's halves
  // At each step's begin, before it. Absent: nothing.
  std::function<void(double t, const World&)> before_step = {};
  bool passivity_control = false;
};

// Of one instrument.
struct OfflineTick {
  double t = 0;
  Vec6 wrench = Vec6::Zero();  // on the instrument, about its origin [N, N·m]
  double penetration = 0;      // [m]
  double residual = 0;
  int active = 0;
  bool swapped = false;  // the first with a new problem
};

// Of each instrument, one a millisecond.
using HandTicks = EachInstrument<std::vector<OfflineTick>>;

// CPU time of a thread's pieces of work [s].
struct ThreadCost {
  std::vector<double> work;
  double total = 0;  // within the window
  double quantile(double percent) const;
};

struct OfflineResult {
  HandTicks hands;  // of the window
  ThreadCost simulation, haptic, bases;
  ThreadCost interim;  // of steps that remove something, from their begin until the interim problem is there
  std::size_t memory_bytes = 0;  // largest: compliances, problems and the haptic loop's scratch
  int removed = 0;
  double cut_area = 0;      // that blades separated, in the rest shape [m²]
  int inverted = 0;         // tetrahedra that were inverted after some step, largest number at a time
  int dropped_samples = 0;  // largest
  int uncovered_nodes = 0;  // of patches, outside their compliance's zone; in all steps together
  int capped = 0;           // ticks and steps whose contact solve ended at a cap
  // Largest of contact_laws.h: of the problems that were published, and of the ticks solved by the daemon.
  double reciprocity = 0, third_law = 0;

  const std::vector<OfflineTick>& ticks() const { return hands[0]; }
};

// False ends the run; the result is then what there is.
using OfflineProgress = std::function<bool(double fraction)>;

OfflineResult run_offline(const Scene& scene, const OfflineInput& input, const OfflineOptions& options,
                          const OfflineProgress& progress = {});

// The truth in time: one loop of step h (1 ms or a part of it), compliance exact, contact of every step
// solved to 1e-10 with its geometry renewed six times, its force felt at the step's own time. The scene's
// compliance and contact are not used.
OfflineResult run_reference(const Scene& scene, const OfflineInput& input, double h,
                            const OfflineProgress& progress = {});

// What the first instrument's tip destroys at `per_step` elements in each 20 ms of the window; without a
// number: what all instruments destroy by their own rules and pedals. What goes by degrees becomes less
// evenly from when a tip met it until it went.
RemovalSchedule record_removals(const Scene& scene, const OfflineInput& input, std::optional<int> per_step);

// Live tetrahedra with det F ≤ 0, over all deformable bodies.
int inverted_tets(const Bodies& bodies);

}  // namespace hapticd
