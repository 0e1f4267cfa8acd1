// Condenses what of a body is far from a place to its boundary (tissue/condensed_tissue.h).
//
//   far: tetrahedra whose centroid at rest is farther from `centre` than `radius`, in parts that faces join and
//   that hold on to the world by three nodes or more; the others stay near
//   C_bb of the far tissue alone, static and linear, is K̂⁻¹;   Ψ e = y of K y = K̂ e on b,   Ψᵀ g = K̂ (C g)_b
//
// Pre: the state is at rest, and nothing was removed or cut. Post: the model has it (TissueModel::condensed),
// nodes beyond the boundary are fixed, far tetrahedra are dead. Nothing changes where nothing is far. Units:
// m. Errors: std::invalid_argument where nothing is near; std::runtime_error from the far tissue's factor.
// Cost: that factor, seven solves with it, and a dense inverse of the boundary's size. Source: Guyan 1965.
#pragma once

#include "physics/tissue/tissue.h"

namespace hapticd {

struct NearRegion {
  Vec3 centre = Vec3::Zero();  // [m]
  double radius = 0;           // [m]
};

void condense_far(TissueModel& model, TissueState& state, const NearRegion& near);

}  // namespace hapticd
