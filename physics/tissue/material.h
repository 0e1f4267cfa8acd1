// Linear isotropic elasticity with Rayleigh damping.
//
//   λ = E ν / ((1+ν)(1−2ν)),   μ = E / (2(1+ν)),   B = α M + β K
//
// Units: E in Pa, density in kg/m³, α in 1/s, β in s. Contract: E > 0, −1 < ν < 0.5, density > 0,
// α, β ≥ 0 (the scene reader refuses anything else, naming the key).
#pragma once

namespace hapticd {

struct Material {
  double young = 0;
  double poisson = 0;
  double density = 0;
  double rayleigh_mass = 0;       // α [1/s]
  double rayleigh_stiffness = 0;  // β [s]

  double lambda() const noexcept { return young * poisson / ((1 + poisson) * (1 - 2 * poisson)); }
  double mu() const noexcept { return young / (2 * (1 + poisson)); }
};

}  // namespace hapticd
