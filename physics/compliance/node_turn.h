// How far each node has turned since a base was made: the R_i of compliance warping.
//
//   Q_i = nearest rotation to Σ_e V_e R_e(now) R_e(base)ᵀ over the live tetrahedra e around node i
//   C_ij ≈ Q_i C_ij(base) Q_jᵀ
//
// Units: V in m³. Q of nodes without live tetrahedra is the identity. The model must outlive it.
// Source: the paper §2.3; Saupin, Duriez, Cotin and Grisoni 2008.
#pragma once

#include <span>
#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

class NodeTurn {
 public:
  explicit NodeTurn(const TissueModel& model);

  void set_base(const std::vector<Mat3>& rotation) { base_ = rotation; }

  // Q of one node at the state's rotations.
  Mat3 operator()(int node, const TissueState& state) const noexcept;

  // Q of every node, in one pass over the tetrahedra.
  void all(const TissueState& state, std::vector<Mat3>& Q) const;

  const std::vector<Mat3>& base() const noexcept { return base_; }

 private:
  const TissueModel& model_;
  std::vector<int> start_;    // nodes + 1
  std::vector<int> tet_;      // of each node, ascending
  std::vector<Mat3> base_;    // per tetrahedron
};

// Angle of a rotation [rad].
double angle_of(const Mat3& rotation) noexcept;

}  // namespace hapticd
