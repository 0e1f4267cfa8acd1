// A scene run for a fraction of a second before it starts, in virtual time: what a choice costs here, and
// what force it answers.
//
//   pilot      the daemon in virtual time (virtual_daemon.h), a tick each millisecond; a step latches and
//              publishes as late as its own cost makes it
//   reference  one loop of step h', every force felt at the step's own time
//   error      √(mean ‖f − f_ref‖²) / max ‖f_ref‖
//   jump       √(mean ‖Δf − Δf_ref‖²) / max ‖f_ref‖ over the milliseconds in which another problem came into
//   use: a
//              step 50 times a second that the error hides, and a hand feels
//
// Nothing is removed, a blade cuts, no limit of the device acts; the first 0.1 s hold the first pose and are
// not in the result. Costs are CPU time of this thread; a reference factor that another thread would make is
// in `cost_ms` alone. Units: N on the instrument, ms. A run that throws or goes out of bounds is empty.
#pragma once

#include <span>
#include <vector>

#include "server/plan/plan_stroke.h"
#include "server/scene/scene.h"

namespace hapticd {

struct TrialRun {
  std::vector<Vec3> force;            // one a millisecond of the stroke; empty: it failed
  std::vector<std::uint8_t> swapped;  // … the first with another problem
  double step_ms = 0;                 // median of a simulation step
  double worst_step_ms = 0;           // 9 of 10 take less
  double tick_ms = 0;                 // median of a haptic tick, in contact
  double cost_ms = 0;  // per simulation step: it, its ticks and the reference factors made meanwhile
  std::vector<std::uint8_t> pressed;  // per body, by the instrument or by a pressed body
};

TrialRun run_pilot(const Scene& scene, const PilotStroke& stroke);

// every_ms: its step.
TrialRun run_reference(const Scene& scene, const PilotStroke& stroke, int every_ms);

// Infinite for an empty run; 0 where the reference feels nothing. Of a reference with a longer step than 1 ms
// the instants it has count.
double force_error(const TrialRun& reference, const TrialRun& run, int every_ms);

// reference: one force every `every_ms`. 0 where nothing was swapped, the reference feels nothing, or the run
// is empty.
double swap_jump(std::span<const Vec3> reference, int every_ms, std::span<const Vec3> force,
                 std::span<const std::uint8_t> swapped);

// What a model's force is off by: its error, and the jumps that the whole model does not have.
double felt_error(double error, double jump, double jump_of_whole);

}  // namespace hapticd
