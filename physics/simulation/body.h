// One body of the scene while it is simulated: model, state and compliance; and what stages of a step keep of
// it.
//
// A rigid body is a fixed obstacle: it has a surface and no unknowns.
// Units: m, N. Shapes: vectors have 3·nodes entries. Errors: std::invalid_argument from the constructor.
#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "physics/compliance/condense_far.h"
#include "physics/compliance/reference_compliance.h"
#include "physics/cutting/tearing.h"
#include "physics/simulation/free_motion.h"
#include "physics/simulation/step/energy_bound.h"
#include "physics/tissue/surface.h"
#include "physics/tissue/tissue.h"
#include "physics/tissue/tissue_parts.h"

namespace hapticd {

struct BodyRegions;

// A deformable body as it stands between two steps, for another world to begin from: removed and torn as it
// is, and moving. What contact, fronts of cuts and factors remember is not in it.
struct BodyStart {
  TissueModel model;
  TissueState state;
  BoundarySurface surface;
  std::shared_ptr<BodyRegions> regions = {};  // null: its near region, if it has one, stays where it is
};

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
  MeshRoom room = {};            // deformable only; for what cuts add
  double toughness = 0;          // against blades [J/m²]; 0: they do not cut it
  TearSettings tearing = {};     // off unless its toughness is positive
  double cutting_viscosity = 0;  // c: what cutting costs more by its speed [N·s/m²]
  std::vector<TissueRegion> regions = {};  // deformable only; a stretched one cannot be cut
  std::vector<NodeSpring> springs = {};    // deformable only; per node, or empty
  std::optional<NearRegion> near = {};     // deformable only; what is farther is condensed
  // Deformable only; null: at rest. Instead of mesh, material, fixed nodes, room, regions, springs and near
  // region; the body is then cut and torn no further.
  std::shared_ptr<const BodyStart> start = {};
};

// Nothing here outlives the function that fills it.
struct BodyScratch {
  VecX force;
  std::vector<Mat3> factored_rotation;  // per tetrahedron, as it is in the present factor
};

struct Body {
  // Model: only a cut changes it.
  std::string name;
  bool deformable;
  double friction;
  bool removable;
  double toughness;          // [J/m²]
  double cutting_viscosity;  // [N·s/m²]
  TearSettings tearing;
  TissueModel model;  // of a rigid body: the mesh only
  const std::vector<Vec3>& rest() const { return model.mesh.nodes; }
  std::shared_ptr<BodyRegions> regions;  // null: all is simulated, or always the same (region/body_regions.h)
  double edge = 0;                       // mean length of the tetrahedra's edges at rest [m]
  double mean_volume = 0;                // … of their volumes, of the first mesh [m³]
  PartTimes* times = nullptr;

  // State.
  int topology = 0;   // cuts so far: how often nodes were added or corners changed
  TissueState state;  // of a rigid body: the positions only
  BoundarySurface surface;
  std::unique_ptr<Compliance> compliance;  // deformable only
  ReferenceCompliance* references;         // the same; null: its method keeps no reference factor
  bool asleep = false;                     // at rest and out of reach: its step is skipped
  bool thinned = false;                    // in this step, some of its tetrahedra

  // Of the stages.
  FreeMotion free;
  Correction corrected;
  EnergyLedger energy;
  BodyScratch scratch;

  Body(BodySettings settings, double h, const Vec3& gravity,
       ComplianceMethod method = ComplianceMethod::exact, const ComplianceOptions& options = {});
  Body(const Body&) = delete;
  Body& operator=(const Body&) = delete;
};

std::shared_ptr<const BodyStart> start_of(const Body& body);

// As it was at first, with what was condensed of it since; null of a body of which nothing is.
std::shared_ptr<const BodyStart> first_start_of(const Body& body);

// The compliance refers to its body's model, so bodies never move.
using Bodies = std::deque<Body>;

// No node is faster than 10 µm/s, and nothing was held back.
bool at_rest(const Body& body);

// Removes tetrahedra and lets mass, surface and orphan nodes follow. Returns those that went, which the
// compliance is to be told before its next update …
std::vector<int> take_out(Body& body, std::span<const int> tets);

// … and this tells it. Returns how many went.
int remove_from(Body& body, std::span<const int> tets);

}  // namespace hapticd
