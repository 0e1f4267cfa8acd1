// A body's free motion, where a step without contact takes it, and the correction that ends the step.
//
//   dynamic  b = M v/h + f_ext + f_int(x),   Δx_free = C b
//   static   b = f_ext + f_int(x);  of a linear body then Δx_free = X + C f_ext − x, without a solve
//   correct  Δx = Δx_free + C f,   x ← x + Δx,   v ← Δx/h                    f: contact forces
//
// A compliance may solve in halves (compliance.h): Δx_free is then right near the zone alone until it is
// finished. Units: m, N. Shapes: vectors have 3·nodes entries. Errors: those of the compliance.
#pragma once

#include <span>
#include <vector>

#include "physics/types.h"

namespace hapticd {

struct Body;

struct FreeMotion {
  VecX dx;                      // Δx_free [m]
  bool in_halves = false;       // the compliance solves in halves …
  bool forward_solved = false;  // … and only the first is done: dx is right where `forward_covers`
  VecX offset;                  // what the second half gives is added to this [m]; empty: to nothing
  bool ahead = false;           // factor and dx are those of the step to come (predicted_linearisation.h)
  VecX predicted;               // Δx_p that linearise_ahead was last given [m]
  VecX under_load;              // of a linear static body: C f_ext [m]
};

// What the last `correct` was given and replaced.
struct Correction {
  VecX force;                  // Σ Hᵀλ [N]
  std::vector<Vec3> v_before;  // [m/s]
};

// Δx_free at the present state, with the factor the compliance holds; near the zone alone, where the
// compliance solves in halves.
void compute_free_motion(Body& body, double h);

// Δx_free = from + C b (from: may be null): the same, of any right-hand side.
void begin_free_motion(Body& body, const VecX& b, const VecX* from);

// Δx_free + C f everywhere, f on the patch's nodes (may be null): one half of a solve where the other is
// done. f may be where the forward half does not reach only if Δx_free is known everywhere.
void finish_free_motion(Body& body, const VecX* f);

// The free motion of these nodes is to be known: of all, if the forward half does not reach these.
void know_free_motion(Body& body, std::span<const int> nodes);

// The rotations of the corrected state, then the free motion there. A tetrahedron that turned by more than
// 0.3 rad in this step has the force of the law its factor was made of: with its new rotation that factor has
// next to no stiffness against it, and a light flap that hangs by an edge would be thrown by metres.
void fresh_free_motion(Body& body, double h);

// What that gives where nothing turned since the factor, and nearly so elsewhere, without a look at an
// element; right after `correct`. What it errs by enters the end of the step that starts from it squared
// (predicted_linearisation.h). The equation is in the source.
void foresee_free_motion(Body& body, double h);

// x += Δx, v = Δx/h of Δx = Δx_free + C f (f: may be null); with `keeps_energy`, of so much of it as makes
// none (energy_bound.h). response: C f, where it is known.
void correct(Body& body, const VecX* contact_force, double h, bool keeps_energy = true,
             const VecX* response = nullptr);

}  // namespace hapticd
