#include "physics/tissue/volume_barrier.h"

#include <Eigen/LU>
#include <algorithm>

namespace hapticd {

namespace {

Mat3 cofactor(const Mat3& F) noexcept {
  Mat3 C;
  C.col(0) = F.col(1).cross(F.col(2));
  C.col(1) = F.col(2).cross(F.col(0));
  C.col(2) = F.col(0).cross(F.col(1));
  return C;
}

double stiffness_of(const TissueModel& model, int tet) noexcept {
  return barrier_stiffness * (model.elastic[tet].lambda + 2 * model.elastic[tet].mu);
}

}  // namespace

double barrier_energy(const TissueModel& model, const TissueState& state, int tet, const Mat3& F) noexcept {
  const double lost = std::max(0.0, barrier_from - F.determinant());
  return 0.5 * volume_left(model, state, tet) * stiffness_of(model, tet) * lost * lost;
}

void barrier(const TissueModel& model, int tet, const Mat3& F, TissueState& state) noexcept {
  const double J = F.determinant();
  if (!(J < barrier_from)) return;
  const double volume = volume_left(model, state, tet);
  const double kappa = stiffness_of(model, tet);
  const double pressure = kappa * (barrier_from - J);
  Collapsed c;
  c.tet = tet;
  c.node = model.mesh.tets[tet];
  c.gradients = model.gradients[tet];
  c.push = cofactor(F) * c.gradients;
  c.force = volume * pressure;
  c.rank_one = volume * kappa;
  c.isotropic = volume * pressure * F.norm();
  c.energy = barrier_energy(model, state, tet, F);
  state.collapsed.push_back(c);
}

}  // namespace hapticd
