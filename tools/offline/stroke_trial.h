// Deep strokes of a phaco tip into a lens, with removals, in virtual time: both loops' own steps, no thread.
//
//   the tip comes down 0.2 mm above the pole at `speed`, goes `depth` below the surface at rest, and up
//   again; each stroke elsewhere within `spread` of the pole; the pedal is down in every second stroke
//
// The daemon in virtual time (server/schedule/virtual_daemon.h), with interim problems and refreshes. A
// problem is felt half a step after its step's begin, 10 ms at most, and the delays before that are at most
// as many parts of a step as they usually are of 20 ms. A tick comes every millisecond, two a step below 2
// ms. Forces are those reported before the device's limits, in the scene's newtons. A fresh lens every
// `episode` steps, cut to whole strokes: none is put around a tip. Deterministic: a function of the settings.
// Units: m, s, N.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "physics/compliance/compliance.h"
#include "physics/tissue/material.h"

namespace hapticd {

struct StrokeSettings {
  std::string mesh = "lens";  // lens, lens_graded: of the cataract scene
  Law law = Law::corotational;
  ComplianceMethod compliance = ComplianceMethod::exact;
  double h = 0.02;
  int steps = 10000;
  int episode = 500;
  double depth = 2e-3;
  double speed = 20e-3;
  double spread = 0.5e-3;
  double tip_radius = 0.6e-3;
  bool removal = true;
  unsigned seed = 1;
};

struct StrokeReport {
  int steps = 0;
  int removed = 0;
  int not_finite = 0;                 // ticks or steps with a number that is none
  int refused = 0;                    // ticks that latched or answered zero for a fault
  int solver_caps = 0;                // contact solves that ended at a cap
  double peak = 0;                    // of the force [N]
  double largest_change = 0;          // of the force from one ms to the next [N]
  double change_p999 = 0;             // … that one of a thousand exceeds, of ticks in contact
  double largest_change_in_step = 0;  // … between two ticks of the same problem: no handover in between
  double left_after = 0;              // largest force while the tip is clear of the lens [N]
  int inverted_steps = 0;             // steps after which some live tetrahedron is inside out
  int most_inverted = 0;              // such tetrahedra at once
  double least_volume = 1;            // smallest det F of a live tetrahedron
  double steps_ms = 0;                // mean time of a simulation step [ms]
  std::vector<double> force;          // along the stroke, per ms, if it was asked for [N]
};

StrokeReport run_strokes(const StrokeSettings& settings, bool keep_force,
                         const std::function<bool(double)>& progress);

}  // namespace hapticd
