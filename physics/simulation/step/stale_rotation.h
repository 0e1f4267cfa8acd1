// Elements that have turned away from the rotation that their body was linearised with.
//
//   at x + Δx:  F,  R' nearest to F;   of those with  ‖f_e(x + Δx; R') − f_e(x + Δx; R)‖ > least
//
// f_e(·; R) is the element's linear law, R sym(RᵀF) in place of F: what the factor has. Where R' is not R,
// the law has the wrong direction and a strain of the turn squared. Only of elements wholly in the
// compliance's zone; those first that err most, until they have `most_stale_nodes` corners together. Units:
// m, N. Shapes: Δx 3·nodes entries, read in the zone alone. Errors: none.
#pragma once

#include <vector>

#include "physics/simulation/body.h"

namespace hapticd {

inline constexpr int most_stale_nodes = 24;

// A live element as it is to be from now on: R instead of the rotation that it was linearised with.
struct StaleRotation {
  int tet;
  Mat3 R;
};

std::vector<StaleRotation> stale_rotations(const Body& body, const VecX& dx, double least);

}  // namespace hapticd
