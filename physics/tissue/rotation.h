// The proper rotation nearest to a deformation gradient, also for flattened and inverted elements.
//
//   R = argmax over SO(3) of tr(RᵀF) = argmin ‖F − R‖;   with A = RᵀF and R ← R exp(δ×):
//   δ = (tr(A) I − sym A)⁻¹ w,   w = (A₃₂ − A₂₃, A₁₃ − A₃₁, A₂₁ − A₁₂)
//
// tr(RᵀF) has one maximum on SO(3) and otherwise only saddles and minima, so a Newton iteration that
// ends where tr(A) I − sym A is positive definite has found R whatever it started from. It is continuous
// in F wherever σ₂ + σ₃ > 0 (σ₃ signed like det F): through flattening and into inversion. Where
// σ₂ + σ₃ = 0 the nearest rotations are many, and the one nearest to the warm start is taken.
// Contract: `start` is a rotation up to round-off drift, which is removed. A non-finite F gives `start` back.
// Guarantee: wait-free, no allocation, bounded (10 Newton steps, then at most 12 Jacobi sweeps).
// Source: Müller et al. 2016 for warm-started extraction; Hestenes' one-sided Jacobi for the fallback.
#pragma once

#include <array>

#include "physics/tissue/element_lanes.h"

namespace hapticd {

Mat3 nearest_rotation(const Mat3& F, const Mat3& start) noexcept;

// The same for eight at once, side by side in vector registers; *R[l] is start and result. Results agree with
// the above to round-off. Several of R may be the same matrix only if their F are the same too.
void nearest_rotations(const Lanes3x3& F, std::array<Mat3*, element_lanes> R) noexcept;

// The same without Newton: signed singular value decomposition, σ₃ taking the sign of det F.
// `start` only decides between equally near rotations.
Mat3 nearest_rotation_by_svd(const Mat3& F, const Mat3& start) noexcept;

}  // namespace hapticd
