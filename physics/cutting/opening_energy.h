// The elastic energy that opening faces releases while the rest of the tissue stands.
//
//   Π(u) = ½ uᵀ K u − gᵀ u,   released = −Π(u) ≤ −min Π,   g_c = f_c − m_c/m Σ_c f_c
//
// u: displacements of the nodes around the opening, once those that part are doubled; K: the stiffness of the
// opened mesh, its rotations as they are; f_c [N]: the force of the tetrahedra on side c of a parted node,
// m_c [kg] their mass there. Nodes that contacts press do not move along their force: hands are held, and do
// no work. So the body loses at least this. Units: J, m². Pre: the state's rotations are those at x. Errors:
// the compliance's. Cost: a millisecond, and a few solves and products with K of the whole body where it may
// be enough. Source: Griffith 1921, of a finite area; what closes it again does the same work (Rybicki and
// Kanninen 1977).
#pragma once

#include <functional>
#include <span>

#include "physics/cutting/cut_workspace.h"

namespace hapticd {

struct OpeningEnergy {
  double area = 0;      // of the faces that come apart, in the rest shape [m²]; 0: none
  double released = 0;  // [J]
};

// dx = C f, 3 entries a node: how the whole body gives way before the opening. Any symmetric positive
// definite C will do; the nearer to K⁻¹, the nearer to −min Π, and without one all but a few hundred nodes
// stay.
using ApplyCompliance = std::function<void(const VecX& f, VecX& dx)>;

// Of open_faces (opening.h) with these faces; only scratch changes. pressed: forces of contacts, 3 a node
// [N]; empty: none. Looked at no longer than to tell whether it is at least toughness · area [J/m²].
OpeningEnergy energy_of_opening(const TissueModel& model, const TissueState& state, CutWorkspace& work,
                                std::span<const int> faces, const VecX& pressed, double toughness,
                                const ApplyCompliance& compliance = {});

}  // namespace hapticd
