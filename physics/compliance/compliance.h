// A body's compliance C = A⁻¹, A = M/h² + B/h + K(u), behind one small interface.
//
//   free motion  Δx_free = C (M v/h + f_ext + f_int(x)),   correction  Δx = Δx_free + C Hᵀλ,
//   patch        C_pp = Eₚᵀ C Eₚ
//
// The nodes near the instrument (the zone) are ordered last, so that C_pp comes from the factor's
// trailing dense corner: L_zz L_zzᵀ = A_zz − A_zr A_rr⁻¹ A_rz.
// Units: A [N/m], C [m/N]; multipliers are newtons for every h. Shapes: vectors of 3·nodes, node-wise
// interleaved; fixed and orphan nodes are identity rows: their entries of every result are zero.
// Errors: `update` throws std::runtime_error when A is not positive definite (a singular model: no
// mass and no support); `apply`, `patch` and `error_estimate` throw it before a successful update.
// Source: the paper, eqs. (2) and (3). Departure: a removal is not a low-rank update here but a
// refactorisation without the element (`exact`).
#pragma once

#include <memory>
#include <span>

#include "physics/tissue/tissue.h"

namespace hapticd {

class Compliance {
 public:
  virtual ~Compliance() = default;

  // Orders these nodes last from the next `update` on. Fixed nodes are allowed and ignored. Patches of the
  // nodes named first are the cheapest: name the nearest first.
  virtual void move_zone(std::span<const int> nodes) = 0;

  // True if every free node of `nodes` lies in the present zone.
  virtual bool zone_covers(std::span<const int> nodes) const = 0;

  // Assembles and factors A at the state's rotations, live tetrahedra only.
  virtual void update(const TissueState& state) = 0;

  // y = C b (b and y of 3·nodes entries; may alias).
  virtual void apply(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) = 0;

  // C_pp of the given zone nodes, 3·|nodes| square, into `block` (rows of fixed or orphan nodes are zero).
  // Contract: zone_covers(nodes) at the last update; std::invalid_argument otherwise.
  virtual void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) = 0;

  // Relative residual ‖A y − b‖/‖b‖ of one sampled solve against the true A(u) of the last update.
  virtual double error_estimate() = 0;
};

// CHOLMOD refactorisation each step: the model of accuracy.
std::unique_ptr<Compliance> make_exact_compliance(const TissueModel& model, double h);

}  // namespace hapticd
