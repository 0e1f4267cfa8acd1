// The compliance of some zone nodes from the factor's dense trailing corner.
//
//   C_pp = Eₚᵀ (L Lᵀ)⁻¹ Eₚ = Xᵀ X,   X = L⁻¹ Eₚ
//
// A column of X is zero above its own place, so nodes are taken in the order of their places, in panels, and
// each panel works on the rows from its first place on: a patch at the corner's end costs p³, whatever
// the zone's size. A large patch of several connected pieces is taken piece by piece: between them L is zero.
// Of nodes outside the corner the caller brings the columns Y = L⁻¹ E of the whole factor.
// Shapes: L 3·zone square, lower triangular; places per patch node, -1: zero rows and columns, unless it is
// among `outside`, patch nodes with three columns of Y each; block 3·patch square. Units: L Lᵀ [N/m], block
// [m/N]. No allocation once the sizes were seen, but for such large patches and nodes outside.
#pragma once

#include <span>
#include <vector>

#include "physics/types.h"

namespace hapticd {

class PatchInverse {
 public:
  using Corner = Eigen::Ref<const MatX, 0, Eigen::OuterStride<>>;
  void operator()(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block);
  void operator()(const Corner& L, std::span<const int> places, std::span<const int> outside, const MatX& Y,
                  Eigen::Ref<MatX> block);

 private:
  void invert(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block);

  std::vector<int> sorted_;  // indices into places, by place
  MatX X_;
  MatX C_;  // in sorted order
  MatX D_;  // of nodes outside with each other, and with a panel
};

}  // namespace hapticd
