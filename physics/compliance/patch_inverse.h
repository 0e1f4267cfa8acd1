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
  // pieces: the places, ascending from 0 on, from which L is zero before. same_L: as in the last call.
  void operator()(const Corner& L, std::span<const int> pieces, std::span<const int> places,
                  std::span<const int> outside, const MatX& half_solved, bool same_L, Eigen::Ref<MatX> block);

 private:
  // Of one piece.
  struct Rows {
    int start = 0;            // its first place
    std::vector<int> row;     // per place: the first of its node's in Y, or −1
    std::vector<int> begins;  // per row of Y: its first column; the piece's size of rows that fill a tile up
    std::vector<int> wanted;  // places, sorted
    std::vector<double> inverses;
    MatX Y;  // 3 rows a node, and room for a tile behind the last
    MatX C;  // −Y Yᵀ of the nodes known, the lower triangle

    int rows() const { return static_cast<int>(begins.size()); }
    void add(const FrontKernels& kernels, const Corner& L);
    void make_room(int rows, Eigen::Index size);
  };

  void begin(Eigen::Index size, std::span<const int> pieces);
  void add_rows(const Corner& L, std::span<const int> places);
  void gather(std::span<const int> places, Eigen::Ref<MatX> block) const;

  const FrontKernels* kernels_ = &front_kernels();
  std::vector<Rows> rows_;
  std::size_t pieces_ = 0;     // of them in use
  std::vector<int> piece_of_;  // per place
  MatX D_;                     // of nodes outside with each other, and with a tile
};

}  // namespace hapticd
