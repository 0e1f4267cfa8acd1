// Tissue of a body that is not simulated: what the nodes where it meets the rest feel of it.
//
//   f_b = load − K̂ (x_b − X_b),   K̂ = K_bb − K_bf K_ff⁻¹ K_fb,   Ψ = −K_ff⁻¹ K_fb,   x_f = X_f + Ψ (x_b − X_b)
//   mass: the rows' sums of Ψᵀ M Ψ, lumped;   load = Ψᵀ (f_ext + f_int(X)) − mass · gravity
//
// b: boundary nodes, f: those beyond. It is linear about the mesh's shape and static (Guyan 1965), damped as
// the tissue is. Its tetrahedra are dead and its nodes beyond the boundary are fixed: they stand where the
// mesh has them, nothing is removed of them, and an instrument that comes there meets a rigid surface.
// Units: m, N, kg. Shapes: three rows a boundary node. Made by compliance/condense_far.h; `load` is one of the
// external forces (tissue.h). Departure from Guyan: the mass is lumped.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "physics/types.h"

namespace hapticd {

struct TissueState;

struct CondensedTissue {
  std::vector<int> node;          // of the boundary, ascending
  std::vector<int> place;         // per node of the model: where in `node`; −1
  std::vector<std::uint8_t> tet;  // per tetrahedron: it is condensed
  std::vector<int> near_node, near_tet;  // what is simulated, ascending; nodes: fixed ones too
  std::vector<Vec3> rest;         // X_b [m]
  std::shared_ptr<const MatX> stiffness;  // K̂ [N/m], symmetric; numberings share it
  std::vector<double> mass;       // [kg]
  VecX load;                      // [N]

  int place_of(int n) const noexcept { return n < static_cast<int>(place.size()) ? place[n] : -1; }
  auto block(int i, int j) const noexcept { return stiffness->block<3, 3>(3 * i, 3 * j); }

  // f −= K̂ (x_b − X_b), entries of all nodes; f −= s K̂ dx_b.
  void add_forces(const TissueState& state, Eigen::Ref<VecX> f) const;
  void subtract_stiffness(const VecX& dx, double s, Eigen::Ref<VecX> f) const;

  // ½ u_b · (K̂ u)_b of each boundary node, u = x + dx − X; dx may be null. Their sum is the energy [J].
  VecX energies(const TissueState& state, const VecX* dx) const;

 private:
  VecX of_boundary(const VecX& all) const;
  VecX moved(const TissueState& state) const;
  void add(const VecX& of_boundary, Eigen::Ref<VecX> all) const;
};

}  // namespace hapticd
