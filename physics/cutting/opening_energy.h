// The elastic energy that opening faces releases while the rest of the tissue stands.
//
//   Π(u) = ½ uᵀ K u − gᵀ u,   released = −Π(u) ≤ −min Π,   g_c = f_c − m_c/m Σ_c f_c
//
// u: displacements of the nodes around the opening, once those that part are doubled; K: the stiffness of the
// opened mesh, its rotations as they are; f_c [N]: the force of the tetrahedra on side c of a parted node,
// m_c [kg] their mass there. Nodes beyond the nearest few hundred stay, and so do those that contacts press:
// free, they would release more. So a body, with the hands on it held, loses at least this. Units: J, m².
// Pre: the state's rotations are those at x. Errors: none. Cost: a millisecond or two. Source: Griffith 1921,
// of a finite area; what closes it again does the same work (Rybicki and Kanninen 1977).
#pragma once

#include <span>

#include "physics/cutting/cut_workspace.h"

namespace hapticd {

struct OpeningEnergy {
  double area = 0;      // of the faces that come apart, in the rest shape [m²]; 0: none
  double released = 0;  // [J]
};

// Of open_faces (opening.h) with these faces; only scratch changes. pressed: forces of contacts, 3 a node
// [N]; empty: none. Looked at no longer than to tell whether it is at least toughness · area [J/m²].
OpeningEnergy energy_of_opening(const TissueModel& model, const TissueState& state, CutWorkspace& work,
                                std::span<const int> faces, const VecX& pressed, double toughness);

}  // namespace hapticd
