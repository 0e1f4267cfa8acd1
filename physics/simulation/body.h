// One body of the scene while it is simulated: model, state, surface, compliance, free motion.
//
//   free motion  b = M v/h + f_ext + f_int(x),   Δx_free = C b
//   static       b = f_ext + f_int(x);  of a linear body then Δx_free = X + C f_ext − x, without a solve
//
// A rigid body is a fixed obstacle: it has a surface and no unknowns.
// Units: m, N. Shapes: vectors have 3·nodes entries.
#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "physics/compliance/reference_compliance.h"
#include "physics/tissue/fragments.h"
#include "physics/tissue/surface.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

struct BodySettings {
  std::string name;
  bool deformable = true;
  TetMesh mesh;
  Material material;             // deformable only
  std::vector<int> fixed_nodes;  // deformable only
  double friction = 0;           // Coulomb μ against the instrument
  bool removable = false;        // the tip may destroy it
  bool corotational = true;      // deformable only; false: linear, right at small rotations only
  bool dynamic = true;           // deformable only; false: no inertia and no damping; it is held, never cut
};

struct Body {
  std::string name;
  bool deformable;
  double friction;
  bool removable;
  TissueModel model;  // of a rigid body: the mesh only
  TissueState state;  // of a rigid body: the positions only
  BoundarySurface surface;
  std::unique_ptr<Compliance> compliance;  // deformable only
  ReferenceCompliance* references;         // the same; null: its method keeps no reference factor
  std::vector<Vec3> rest;                  // rest positions, where sample points are laid out
  VecX dx_free;                            // known near the zone only while `forward_solved`
  VecX dx_predicted;                       // Δx_p that linearise_ahead was last given
  VecX under_load;                         // of a linear static body: C f_ext
  VecX scratch;
  std::vector<Mat3> factored_rotation;  // per tetrahedron, as it is in the present factor
  bool forward_solved = false;    // dx_free is known only where `references->forward_covers`
  bool in_halves = false;         // the last solve was started with its forward half
  VecX forward_offset;            // … and its result is added to this; empty: to nothing
  VecX pressed;                   // Σ Hᵀλ of the last `correct` [N]
  std::vector<Vec3> v_before;     // … and v before it
  Pieces pieces;                  // of the live tissue; none: not known
  VecX elastic;                   // E of each at the state [J]; none: not known
  int bounded_steps = 0;          // in a row, whose motion would have made energy (energy_bound.h)
  bool asleep = false;            // at rest and out of reach: its step is skipped

  // Of methods that keep a reference factor: whether one is being made elsewhere, since when, and how long
  // the last took.
  bool reference_wanted = false;
  bool reference_under_way = false;
  bool reference_outdated = false;  // … but a step has made a newer one itself
  int reference_steps = 0;
  int last_reference_steps = 2;
  double edge = 0;  // mean length of the tetrahedra's edges at rest [m]
  PartTimes* times = nullptr;

  Body(BodySettings settings, double h, const Vec3& gravity,
       ComplianceMethod method = ComplianceMethod::exact, const ComplianceOptions& options = {});
  Body(const Body&) = delete;
  Body& operator=(const Body&) = delete;
};

// The compliance refers to its body's model, so bodies never move.
using Bodies = std::deque<Body>;

// No node is faster than 10 µm/s, and nothing was held back.
bool at_rest(const Body& body);

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

// The rotations of the corrected state, then the same. A tetrahedron that turned by more than 0.3 rad in this
// step has the force of the law its factor was made of: with its new rotation that factor has next to no
// stiffness against it, and a light flap that hangs by an edge would be thrown by metres, its neighbours too.
void fresh_free_motion(Body& body, double h);

// What that gives where nothing turned since the factor, and nearly so elsewhere, without a look at an
// element; right after `correct`, which has Δx, f and v from before. Of A Δx = M v/h + f_ext + f_int + f,
// with s = 1 + β/h:
//
//   Δx_free = (1 − 1/s) Δx + C (M ((v⁺ − v)/h + (1/h² + α/h) Δx/s) − f)
//
// Where a step only foresees with it, what it errs by enters that step's end squared
// (predicted_linearisation.h).
void foresee_free_motion(Body& body, double h);

// x += Δx, v = Δx/h of Δx = Δx_free + C f (f: contact forces per node, may be null); with `keeps_energy`, of
// so much of it as makes none.
void correct(Body& body, const VecX* contact_force, double h, bool keeps_energy = true);

// Removes tetrahedra and lets mass, surface and orphan nodes follow. Returns those that went, which the
// compliance is to be told before its next update …
std::vector<int> take_out(Body& body, std::span<const int> tets);

// … and this tells it. Returns how many went.
int remove_from(Body& body, std::span<const int> tets);

}  // namespace hapticd
