// How far the tissue has turned since a reference factor was made: the R_i of compliance warping.
//
//   C_ij ≈ Q_i C_ij(reference factor) Q_jᵀ
//   Q_i = nearest rotation to Σ_e V_e R_e(now) R_e(reference factor)ᵀ over the live tetrahedra e
//         around node i (by node, the paper's), or of the connected piece that node i belongs to (by piece)
//
// Either undoes a rigid turn exactly. By node, neighbours in strained tissue get different turns, and Qᵀ A Q
// then resists even a translation: indented and bent tissue is modelled worse than without any warping, by up
// to four times (compliance/README.md). By piece, a translation stays free. Units: V in m³. Q of nodes
// without live tetrahedra is the identity. The model must outlive it. Source: the paper §2.3; Saupin, Duriez,
// Cotin and Grisoni 2008.
#pragma once

#include <span>
#include <vector>

#include "physics/compliance/compliance.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

class WarpRotation {
 public:
  explicit WarpRotation(const TissueModel& model);

  // Of the tetrahedra before `known`; those split from them since have turned from where these were.
  void set_reference(const std::vector<Mat3>& rotation, int known);

  // A cut changed the corners of these tetrahedra, or took them into use.
  void reshape(std::span<const int> tets);

  // Q of one node at the state's rotations.
  Mat3 operator()(int node, const TissueState& state) const noexcept;

  // Q of every node, in one pass over the tetrahedra (by piece: a second one after a removal that may have
  // cut, and after any cut).
  void all(Warping warping, const TissueState& state, std::vector<Mat3>& Q);

  const std::vector<Mat3>& reference() const noexcept { return reference_; }

 private:
  void by_node(const TissueState& state, std::vector<Mat3>& Q) const;
  void by_piece(const TissueState& state, std::vector<Mat3>& Q);
  bool still_whole(const TissueState& state);
  template <class Use>
  void each_around(int node, const TissueState& state, const Use& use) const;
  void link(int tet);
  void inherit_reference(int tet);
  bool joined_around(const Tet& tet, const TissueState& state);

  const TissueModel& model_;
  // The tetrahedra around each node as lists of corners 4·tet + a, which a cut changes in place; -1: its end.
  std::vector<int> first_;       // per node
  std::vector<int> next_;        // per corner
  std::vector<Tet> corners_;     // per tetrahedron, as they are linked
  std::vector<Mat3> reference_;  // per tetrahedron
  int known_;                    // tetrahedra that the reference factor knows
  std::vector<int> piece_of_tet_;
  std::vector<int> piece_of_node_;  // -1: orphan
  std::vector<Mat3> sum_;           // per piece
  int removed_ = -1;                // at which the pieces were found
  std::vector<int> parent_;         // scratch, per node
};

// Angle of a rotation [rad].
double angle_of(const Mat3& rotation) noexcept;

}  // namespace hapticd
