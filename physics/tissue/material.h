// Linear isotropic elasticity with Rayleigh damping.
//
//   λ = E ν / ((1+ν)(1−2ν)),   μ = E / (2(1+ν)),   B = α M + β K
//
// Units: E in Pa, density in kg/m³, α in 1/s, β in s. Contract: E > 0, −1 < ν < 0.5, density > 0,
// α, β ≥ 0 (the scene reader refuses anything else, naming the key).
#pragma once

#include <cstdint>

namespace hapticd {

// corotational: small strain in turned axes, the default. guarded: the same, and a pressure in tetrahedra
// that have all but lost their volume (volume_barrier.h).
enum class Law : std::uint8_t { corotational, guarded };

struct Material {
  double young = 0;
  double poisson = 0;
  double density = 0;
  double rayleigh_mass = 0;       // α [1/s]
  double rayleigh_stiffness = 0;  // β [s]
  Law law = Law::corotational;

  double lambda() const noexcept { return young * poisson / ((1 + poisson) * (1 - 2 * poisson)); }
  double mu() const noexcept { return young / (2 * (1 + poisson)); }
};

// Of a nearly incompressible material, one that locks less: ν lowered to `ratio`, E raised so that the indentation
// modulus E/(1 − ν²) stays. A material below the ratio is left as it is.
inline Material lowered(Material m, double ratio) noexcept {
  if (m.poisson <= ratio) return m;
  m.young *= (1 - ratio * ratio) / (1 - m.poisson * m.poisson);
  m.poisson = ratio;
  return m;
}

}  // namespace hapticd
