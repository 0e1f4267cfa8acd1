// How the stored energy falls as nodes move through the material: what drives a crack.
//
//   G_n(Q) = −∂E/∂X_n − Qᵀ ∂E/∂x_n = Σ_e V_e ((F − Q)ᵀ P − w I) g_n,   P = ∂w/∂F,   E = Σ_e V_e w
//
// The node's place moves along with it by Q, the turn of the tissue there: in equilibrium that changes
// nothing, and short of it the forces left over, which are larger than G where strains are small, are not
// counted. Inside a body G is zero but for the mesh's error; at the front of a crack that runs along t
//
//   J = t · Σ_n q_n G_n / ∫ q ds
//
// is the energy that a unit of new area releases, for any q that is 1 at the front and falls to zero around
// it. Units: G in N, J in J/m². Shapes: 3·nodes. Pre: the state's rotations are those at x. Errors: none.
// Source: Eshelby 1951; Miehe and Gürses, Int. J. Numer. Meth. Engng 72 (2007) 127; departure: Q.
#pragma once

#include "physics/tissue/tissue.h"

namespace hapticd {

// Sums over the live tetrahedra. A guarded one's volume barrier is left out.
struct ConfigurationalForces {
  VecX at_rest;   // G(0): places stay
  VecX at_place;  // ∂E/∂x

  Vec3 at(int node, const Mat3& Q) const {
    return at_rest.segment<3>(3 * node) - Q.transpose() * at_place.segment<3>(3 * node);
  }
};
ConfigurationalForces configurational_forces(const TissueModel& model, const TissueState& state);

}  // namespace hapticd
