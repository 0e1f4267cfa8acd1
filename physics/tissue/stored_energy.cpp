#include "physics/tissue/stored_energy.h"

#include "physics/tissue/element_lanes.h"
#include "physics/tissue/rotation.h"
#include "physics/tissue/tetrahedron.h"
#include "physics/tissue/volume_barrier.h"

namespace hapticd {
namespace {

// add(t, energy) of each live tetrahedron.
template <typename Add>
void each_energy(const TissueModel& model, const TissueState& state, const VecX& dx,
                 const Add& add) noexcept {
  each_eight(model, state, [&](const int* tet, int count) {
    Lanes3x4 x, moved, g;
    Lanes3x3 F;
    load_corners(
        model, tet, [&](int n) { return state.x[n].data(); }, x);
    load_corners(
        model, tet, [&](int n) { return dx.data() + 3 * static_cast<std::ptrdiff_t>(n); }, moved);
    for (int k = 0; k < 12; ++k)
      for (int l = 0; l < element_lanes; ++l) x.m[k][l] += moved.m[k][l];
    load_gradients(model, tet, g);
    deformation_gradients(x, g, F);
    std::array<Mat3, element_lanes> R;
    std::array<Mat3*, element_lanes> to;
    for (int l = 0; l < element_lanes; ++l) {
      R[l] = state.rotation[tet[l]];
      to[l] = &R[l];
    }
    if (model.corotational) nearest_rotations(F, to);
    for (int l = 0; l < count; ++l) {
      const Mat3 of = F.matrix(l);
      const Mat3 strained = model.corotational ? of : Mat3(0.5 * (of + of.transpose()));
      const Elasticity& law = model.elastic[tet[l]];
      double energy = element_energy(strained, R[l], volume_left(model, state, tet[l]), law.mu, law.lambda);
      if (model.corotational && model.material.law == Law::guarded)
        energy += barrier_energy(model, state, tet[l], of);
      add(tet[l], energy);
    }
  });
}

// add(n, energy) of each node with a spring and tissue, and of each where condensed tissue begins.
template <typename Add>
void each_node_energy(const TissueModel& model, const TissueState& state, const VecX& dx,
                      const Add& add) noexcept {
  for (std::size_t n = 0; n < model.springs.size(); ++n)
    if (state.live_tets_of_node[n] > 0)
      add(static_cast<int>(n),
          spring_energy(model.springs[n], state.x[n] + dx.segment<3>(static_cast<Eigen::Index>(3 * n))));
  if (!model.condensed) return;
  const VecX energy = model.condensed->energies(state, &dx);
  for (std::size_t i = 0; i < model.condensed->node.size(); ++i)
    add(model.condensed->node[i], energy[static_cast<Eigen::Index>(i)]);
}

}  // namespace

double stored_energy(const TissueModel& model, const TissueState& state, const VecX& dx) noexcept {
  double sum = 0;
  each_energy(model, state, dx, [&](int, double energy) { sum += energy; });
  each_node_energy(model, state, dx, [&](int, double energy) { sum += energy; });
  return sum;
}

void stored_energies(const TissueModel& model, const TissueState& state, const Pieces& pieces, const VecX& dx,
                     VecX& energy) noexcept {
  energy.setZero();
  each_energy(model, state, dx, [&](int t, double of_tet) { energy[pieces.of_tet[t]] += of_tet; });
  each_node_energy(model, state, dx, [&](int n, double of_node) {
    // Where condensed tissue begins all that was near may be gone: that is nobody's piece.
    if (pieces.of_node[n] >= 0) energy[pieces.of_node[n]] += of_node;
  });
}

}  // namespace hapticd
