// The compliance of some zone nodes from the factor's dense trailing corner.
//
//   C_pp = Eₚᵀ (L Lᵀ)⁻¹ Eₚ = Xᵀ X,   X = L⁻¹ Eₚ
//
// A column of X is zero above its own place, so nodes are taken in the order of their places, in panels, and
// each panel works on the rows from its first place on: a patch at the corner's end costs p³, whatever
// the zone's size. Of the L of the last call, columns that are known are used again: a patch that has moved
// on a little costs what is new of it. A large patch of several connected pieces is taken piece by piece:
// between them L is zero. Of nodes outside the corner the caller brings the columns Y = L⁻¹ E of the whole
// factor.
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
  // same_L: as in the last call.
  void operator()(const Corner& L, std::span<const int> places, std::span<const int> outside, const MatX& Y,
                  bool same_L, Eigen::Ref<MatX> block);

 private:
  struct Panel {
    int first, nodes;  // of its columns
    Eigen::Index top;  // row from which on they are known; they are zero above it
  };

  void invert(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block);
  void add_columns(const Corner& L, std::span<const int> places);
  void add_panel(const Corner& L, std::span<const int> places);
  int known_nodes() const;
  void gather(std::span<const int> places, Eigen::Ref<MatX> block) const;

  std::vector<Panel> panels_;
  std::vector<int> column_;  // per place: its node's among those known, or −1
  std::vector<int> new_;     // places, sorted
  MatX X_;                   // 3 columns a node
  MatX C_;                   // of the nodes known, the lower triangle
  MatX D_;                   // of nodes outside with each other, and with a panel
};

}  // namespace hapticd
