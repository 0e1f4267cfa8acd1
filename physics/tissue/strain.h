// The equivalent strain of a deformation gradient: √(2/3) ‖dev E‖, E = ½ (FᵀF − I); no turn changes it.
#pragma once

#include <cmath>

#include "physics/types.h"

namespace hapticd {

inline double equivalent_strain(const Mat3& F) noexcept {
  const Mat3 E = 0.5 * (F.transpose() * F - Mat3::Identity());
  const Mat3 dev = E - E.trace() / 3 * Mat3::Identity();
  return std::sqrt(2.0 / 3) * dev.norm();
}

}  // namespace hapticd
