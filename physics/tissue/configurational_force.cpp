// F = Σ x_a g_aᵀ depends on the rest shape through g alone: moving X_b by δ turns g_a into g_a − (g_a·δ) g_b,
// so δF = −F δ g_bᵀ, and V grows by V g_b·δ. With ∂w/∂F = P: δE = V (w g_b·δ − P : F δ g_bᵀ) = V ((w I − Fᵀ
// P) g_b)·δ.
#include "physics/tissue/configurational_force.h"

#include "physics/tissue/tetrahedron.h"

namespace hapticd {

ConfigurationalForces configurational_forces(const TissueModel& model, const TissueState& state) {
  ConfigurationalForces G{VecX::Zero(3 * model.node_count()), VecX::Zero(3 * model.node_count())};
  for (int t = 0; t < model.tet_count(); ++t) {
    if (!state.alive[t]) continue;
    const auto [mu, lambda, density] = model.elastic[t];
    const Mat3 F = deformation_gradient(corners_of(model.mesh.tets[t], state.x), model.gradients[t]);
    const Mat3& R = state.rotation[t];
    const double dilation = R.cwiseProduct(F).sum() - 3;
    const Mat3 P = 2 * mu * (F - R) + lambda * dilation * R;
    Mat3 eshelby = F.transpose() * P;
    eshelby.diagonal().array() -= element_energy(F, R, 1, mu, lambda);
    const double volume = volume_left(model, state, t);
    const Gradients rest = volume * eshelby * model.gradients[t];
    const Gradients place = volume * P * model.gradients[t];
    for (int a = 0; a < 4; ++a) {
      G.at_rest.segment<3>(3 * model.mesh.tets[t][a]) += rest.col(a);
      G.at_place.segment<3>(3 * model.mesh.tets[t][a]) += place.col(a);
    }
  }
  return G;
}

}  // namespace hapticd
