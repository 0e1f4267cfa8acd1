// What one tetrahedron adds to A, as a product V Vᵀ, so that taking it out is a low-rank change.
//
//   a_e = (1/h² + α/h) m_e + (1 + β/h) k_e(R) = V Vᵀ,   A' = A − G V Vᵀ Gᵀ
//
// V is the Cholesky factor of a_e with its corners in the order given, so that late corners have short
// columns; without mass the six rigid modes leave no column: 12 with mass, 6 without.
// Shapes: V 12 × 12, `rank` columns in use, three rows per corner; rows of fixed nodes are zero.
// Units: V Vᵀ [N/m], h [s]. Source: the paper, eq. (3), where S_e = −a_e; in this form S_e⁻¹, which does not
// exist without mass, is never needed.
#pragma once

#include <cstdint>

#include "physics/tissue/tissue.h"

namespace hapticd {

// Whether a term is added to A or taken out of it.
enum class TermSign : std::uint8_t { add, take_out };

struct ElementTerm {
  std::array<int, 4> node{};
  int corners = 0;  // how many of `node` are in use
  int rank = 0;
  Eigen::Matrix<double, 12, 12> V = Eigen::Matrix<double, 12, 12>::Zero();
};

// left: the share of the tetrahedron that is there. `corners`: its nodes in the order wanted.
ElementTerm element_term(const TissueModel& model, double h, int tet, double left, const Mat3& rotation,
                         const Tet& corners) noexcept;

// A multiple of the identity on one node: what an orphan's row is left with.
ElementTerm identity_term(int node, double scale) noexcept;

}  // namespace hapticd
