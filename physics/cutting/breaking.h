// Which faces break: where the tension across them would drive a crack of their size, and where opening them
// releases at least what the new area costs.
//
//   c σₙ² l/E' > toughness  of each face,   σₙ = n · σ n,   E' = E/(1 − ν²),   l = √area
//   −ΔΠ ≥ toughness · ΔA    of all that open together, next to one another   (opening_energy.h)
//
// σₙ is the mean of the face's two tetrahedra, in their turned frames; only tension opens faces. Looked at
// are inner faces with an edge on the surface or on a face that opens with them, so a crack begins there and
// goes on from what opened: 8 · most of them together, as where no slit is yet a few release little, whatever
// they cost in the end. Where the energy is not there for so many, it is looked for of half as many, and so
// on. Where they part no node yet, `most` are held open (opening.h) and cost nothing until one does. Of a
// cleft all that pay open at once, elsewhere the first `most`: the others then see how tension has turned. A
// crack that may choose its faces wanders and leaves crumbs, though a tetrahedron keeps one face joined:
// where tissue parts along known planes, name their faces (`clefts`). Units: Pa, m, J/m². Pre: the state's
// rotations are those at x. Errors: none. Cost: a pass over the tetrahedra, and opening_energy.h's where
// tension is enough. Source: Griffith 1921; both conditions at once: Leguillon, Eur. J. Mech. A 21 (2002) 61.
#pragma once

#include <vector>

#include "physics/cutting/cut_workspace.h"
#include "physics/cutting/opening_energy.h"
#include "physics/cutting/tearing.h"

namespace hapticd {

// [J/m²] of an inner face by its tension, by its id; zero under compression.
double release_of_face(const TissueModel& model, const TissueState& state, int face);

// Energy grows as tension squared: no need to look again before that has grown by what was missing, or the
// mesh has changed (`until` is zero then). One for each body.
struct RefusedBreaks {
  double until = 0;  // Σ release_of_face over the faces under enough tension [J/m²]
  int places = 0;    // that were looked at, this time round …
  int halved = 0;    // … and how often the faces of the next were halved
  double paid = 0;   // largest part of the energy that was there at one of them
};

// Ids of the faces that open now, at one place. pressed: forces of contacts on nodes, 3 each [N]; empty:
// none. refused: null looks at all places in each call. compliance: of the body (opening_energy.h).
std::vector<int> faces_that_break(const TissueModel& model, const TissueState& state,
                                  const BoundarySurface& surface, CutWorkspace& work,
                                  const TearSettings& settings, const VecX& pressed = {},
                                  RefusedBreaks* refused = nullptr, const ApplyCompliance& compliance = {});

}  // namespace hapticd
