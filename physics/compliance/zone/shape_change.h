// What tetrahedra that took other forms change of A, in as few columns as it has rank.
//
//   ΔA = Σ a_new − Σ a_old = V₊V₊ᵀ − V₋V₋ᵀ,   a_e = (1/h² + α/h) m_e + (1 + β/h) k_e(R)
//
// Most of ΔA cancels: re-pointing any number of tetrahedra from a node to its duplicate changes only these
// two nodes' rows (rank 12), and splitting an edge only those of its ends and its middle. Element by element
// it would be up to 24 columns each. Shapes: V three rows for each of `nodes`; rows of fixed nodes are zero.
// Units: V Vᵀ [N/m]. Source: Bunch and Parlett 1971, for the pivots.
#pragma once

#include <span>
#include <vector>

#include "physics/compliance/system_matrix.h"

namespace hapticd {

struct SignedElement {
  SystemMatrix::Element form;
  Mat3 rotation;
  double sign;  // 1: new; −1: old
};

struct ShapeChange {
  std::vector<int> nodes;
  MatX added, taken_out;  // V₊, V₋
};

// `law`: moduli and mass; `fixed`: per node.
ShapeChange shape_change(const SystemMatrix& law, std::span<const std::uint8_t> fixed,
                         std::span<const SignedElement> elements);

}  // namespace hapticd
