// What the haptic loop feels of a piece that is pushed against what holds it, while between two steps the
// contacts of bodies stay as the last step left them (body_contact_condense.cpp).
//
//   e(t) = f(t) − f_full(t) at each millisecond of one step in which the device moves by `moved`
//   f       the loop's own solve (haptic_options) of the published problem, its memory kept from tick to tick
//   f_full  instrument, bodies and pieces solved as one at that pose (World::solve_unfrozen): the joint
//   problem
//           at 1 kHz
//
// A piece settles. The tip comes down along the normal of that face of it whose normal points best at the
// middle of what holds it, until it feels `pressed` or is `deepest` deep, holds, and in one step moves on
// deeper or aside. Each direction starts afresh. The coupling's damping is left out: it depends on the
// period, which is the loop's in one solve and the step's in the other. Errors are relative to the peak of
// f_full in that step, as in force_error.h. A loose piece rolls from under the tip: then there is little
// force, and most of it is error. Units: m, N. Errors: as make_world; std::runtime_error for a piece that
// lies on nothing.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/scene/scene.h"

namespace hapticd {

struct PushSettings {
  double pressed = 0.5e-3;                  // [N]
  double deepest = 0.6e-3, moved = 0.4e-3;  // [m]
  double above = 0.3e-3;                    // of the piece, at first [m]
  double speed = 5e-3;                      // of coming down [m/s]
  int settle = 60, hold = 10;               // steps
};

struct PushPoint {
  std::string scene, direction;
  double peak = 0;                  // of f_full [N]
  double rms = 0;                   // of e [N]
  double rms_rel = 0, max_rel = 0;  // of e, to the peak
  double rms_rel_to_rms = 0;        // … to the RMS of f_full
  double depth = 0;                 // of the tip below where it would touch the piece at rest [m]
  double step_rel = 0;              // f_full at the motion's end, less what the step finds, to the peak
  double at_rest_rel = 0;           // e before the motion, to the peak
  int touches = 0, active_before = 0, active_after = 0;  // contacts of bodies: in the solve, that bear force
  int unsolved = 0;  // solves of either kind that did not end at their tolerance
};

// The first piece of a scene's first body.
std::vector<PushPoint> push_piece(const Scene& scene, const PushSettings& settings,
                                  const std::function<bool(double)>& progress);

// A soft block on another (tests/support/rubbing_worlds.h), which cannot roll.
std::vector<PushPoint> push_block(double mu, const PushSettings& settings,
                                  const std::function<bool(double)>& progress);

// Whether the tip has hold of the piece; less is not felt (2 mN at a device, where 10 mN are 1 N).
inline bool holds(const PushPoint& push) { return push.peak >= 0.02e-3; }

// Largest rms_rel of those pushes in which the tip has hold of the piece; 0: in none.
double worst_rms_rel(const std::vector<PushPoint>& pushes);

}  // namespace hapticd
