#include "physics/simulation/energy_bound.h"

#include <cmath>

#include "physics/tissue/stored_energy.h"

namespace hapticd {
namespace {

constexpr int most_halvings = 12;
constexpr double round_off = 1e-13;  // of the energies that are summed

double kinetic_energy_of(const TissueModel& model, const TissueState& state, const VecX& dx,
                         double h) noexcept {
  double sum = 0;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) sum += state.mass[n] * dx.segment<3>(3 * n).squaredNorm();
  return 0.5 * sum / (h * h);
}

}  // namespace

double kinetic_energy(const TissueModel& model, const TissueState& state) noexcept {
  double sum = 0;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) sum += state.mass[n] * state.v[n].squaredNorm();
  return 0.5 * sum;
}

EnergyBound bound_energy(const TissueModel& model, const TissueState& state, double elastic, const VecX& dx,
                         const VecX& f, double h) noexcept {
  const double before = kinetic_energy(model, state) + elastic, work = f.dot(dx),
               moving = kinetic_energy_of(model, state, dx, h);
  const double allowed = before + round_off * (before + std::abs(work));
  EnergyBound bound;
  VecX part = dx;
  for (int k = 0; k <= most_halvings; ++k, bound.share *= 0.5) {
    if (k > 0) part *= 0.5;
    bound.elastic = stored_energy(model, state, part);
    if (bound.share * bound.share * moving + bound.elastic <= allowed + bound.share * work) return bound;
  }
  return {0, elastic};
}

}  // namespace hapticd
