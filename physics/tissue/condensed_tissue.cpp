#include "physics/tissue/condensed_tissue.h"

#include "physics/tissue/tissue.h"

namespace hapticd {

VecX CondensedTissue::of_boundary(const VecX& all) const {
  VecX of(3 * static_cast<Eigen::Index>(node.size()));
  for (std::size_t i = 0; i < node.size(); ++i)
    of.segment<3>(3 * static_cast<Eigen::Index>(i)) = all.segment<3>(3 * static_cast<Eigen::Index>(node[i]));
  return of;
}

VecX CondensedTissue::moved(const TissueState& state) const {
  VecX u(3 * static_cast<Eigen::Index>(node.size()));
  for (std::size_t i = 0; i < node.size(); ++i)
    u.segment<3>(3 * static_cast<Eigen::Index>(i)) = state.x[static_cast<std::size_t>(node[i])] - rest[i];
  return u;
}

void CondensedTissue::add(const VecX& of, Eigen::Ref<VecX> all) const {
  for (std::size_t i = 0; i < node.size(); ++i)
    all.segment<3>(3 * static_cast<Eigen::Index>(node[i])) += of.segment<3>(3 * static_cast<Eigen::Index>(i));
}

void CondensedTissue::add_forces(const TissueState& state, Eigen::Ref<VecX> f) const {
  const VecX u = moved(state);
  add(-(stiffness->selfadjointView<Eigen::Lower>() * u), f);
}

void CondensedTissue::subtract_stiffness(const VecX& dx, double s, Eigen::Ref<VecX> f) const {
  const VecX u = of_boundary(dx);
  add(-s * (stiffness->selfadjointView<Eigen::Lower>() * u), f);
}

VecX CondensedTissue::energies(const TissueState& state, const VecX* dx) const {
  VecX u = moved(state);
  if (dx) u += of_boundary(*dx);
  const VecX force = stiffness->selfadjointView<Eigen::Lower>() * u;
  VecX energy(static_cast<Eigen::Index>(node.size()));
  for (Eigen::Index i = 0; i < energy.size(); ++i)
    energy[i] = 0.5 * u.segment<3>(3 * i).dot(force.segment<3>(3 * i));
  return energy;
}

}  // namespace hapticd
