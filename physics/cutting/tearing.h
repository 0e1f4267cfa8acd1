// Which faces tear: where the front of a slit would release more energy than new area costs.
//
//   J_f = d_f · Σ_n q_n G_n / ∫ q ds > toughness,   q_n = max(0, 1 − |X_n − m|/r)
//
// A front edge is one of the boundary about which the live tetrahedra reach nearly all the way round: from
// one side of a slit to the other. Of the inner faces at it that lie ahead, each with its direction d_f away
// from the edge, the one with the largest J_f is looked at; m is the edge's middle. Nodes of the first mesh's
// boundary move along it. Units: m, J/m². Pre: the state's rotations are those at x, and forces that hold the
// body act farther than r from the front. Errors: none.
// Cost: one pass over the boundary, and over the tetrahedra where there is a front. Source:
// configurational_force.h; Miehe and Gürses 2007, whose crack likewise follows the mesh's faces.
#pragma once

#include <cstdint>
#include <vector>

#include "physics/tissue/surface.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

struct TearSettings {
  double toughness = 0;                   // [J/m²]; 0: nothing tears
  double radius = 0;                      // r [m], some edge lengths; 0: fronts of slits are not looked for
  int most = 8;                           // faces in one step
  bool begins = false;                    // cracks begin at surfaces, too (breaking.h) …
  std::vector<std::uint8_t> clefts = {};  // … of these faces, per id in the first mesh; empty: of all
};

struct FrontEdge {
  int a, b;              // its nodes
  std::vector<int> fan;  // tetrahedra about it, from one side of the slit to the other
  int face = -1;         // id of the inner face with the largest J
  double release = 0;    // that J [J/m²]
};

// All edges of all fronts, and what they would release; `radius`: r.
std::vector<FrontEdge> crack_fronts(const TissueModel& model, const TissueState& state,
                                    const BoundarySurface& surface, double radius);

// Ids of the faces that open now, those that release most first.
std::vector<int> faces_that_tear(const TissueModel& model, const TissueState& state,
                                 const BoundarySurface& surface, const TearSettings& settings);

}  // namespace hapticd
