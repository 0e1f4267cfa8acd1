// The compliance of some zone nodes from the factor's dense trailing corner.
//
//   C_pp = Eₚᵀ (L Lᵀ)⁻¹ Eₚ = Y Yᵀ,   Y = Eₚᵀ L⁻ᵀ
//
// A row of Y is zero before its own place, so nodes are taken in the order of their places, and a tile of
// rows is worked on from its first place on: a patch at the corner's end costs p³, whatever the zone's size.
// Of the L of the last call, rows that are known are used again: a patch that has moved on a little costs
// what is new of it. A large patch of several connected pieces is taken piece by piece: between them L is
// zero. Of nodes outside the corner the caller brings the columns L⁻¹ E of the whole factor. Shapes: L 3·zone
// square, lower triangular; places per patch node, -1: zero rows and columns, unless it is among `outside`,
// patch nodes with three columns of `half_solved` each; block 3·patch square. Units: L Lᵀ [N/m], block [m/N].
// No allocation once the sizes were seen, but for such large patches and nodes outside.
#pragma once

#include <span>
#include <vector>

#include "physics/compliance/factor/front_kernels.h"
#include "physics/types.h"

namespace hapticd {

class PatchInverse {
 public:
  using Corner = Eigen::Ref<const MatX, 0, Eigen::OuterStride<>>;
  void operator()(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block);
  // same_L: as in the last call.
  void operator()(const Corner& L, std::span<const int> places, std::span<const int> outside,
                  const MatX& half_solved, bool same_L, Eigen::Ref<MatX> block);

 private:
  void invert(const Corner& L, std::span<const int> places, Eigen::Ref<MatX> block);
  void forget() { begins_.clear(); }
  int rows() const { return static_cast<int>(begins_.size()); }
  void add_rows(const Corner& L, std::span<const int> places);
  void make_room(int rows, Eigen::Index size);
  void gather(std::span<const int> places, Eigen::Ref<MatX> block) const;

  const FrontKernels* kernels_ = &front_kernels();
  std::vector<int> row_;     // per place: the first of its node's in Y, or −1
  std::vector<int> begins_;  // per row of Y: its first column; the corner's size of rows that fill a tile up
  std::vector<int> new_;     // places, sorted
  std::vector<double> inverses_;
  MatX Y_;  // 3 rows a node, and room for a tile behind the last
  MatX C_;  // −Y Yᵀ of the nodes known, the lower triangle
  MatX D_;  // of nodes outside with each other, and with a tile
};

}  // namespace hapticd
