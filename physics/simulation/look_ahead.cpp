#include "physics/simulation/look_ahead.h"

#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

// f −= s K dx, K of the rotations in the state: of the factor's own linear law.
void subtract_stiffness(const Body& body, const VecX& dx, double s, VecX& f) {
  const TissueModel& m = body.model;
  const double mu = m.material.mu(), lambda = m.material.lambda();
  for (int t = 0; t < m.tet_count(); ++t) {
    if (!body.state.alive[t]) continue;
    const Tet& tet = m.mesh.tets[t];
    Corners motion;
    for (int a = 0; a < 4; ++a) motion.col(a) = dx.segment<3>(3 * tet[a]);
    const Mat3& R = body.state.rotation[t];
    const Mat3 A = R.transpose() * deformation_gradient(motion, m.gradients[t]);
    const Mat3 strained = R * (Mat3::Identity() + 0.5 * (A + A.transpose()));
    const Corners force = element_forces(strained, R, m.gradients[t], m.volume[t], mu, lambda);
    for (int a = 0; a < 4; ++a) f.segment<3>(3 * tet[a]) += s * force.col(a);
  }
}

double volume(const Body& body, int t, bool ahead) {
  const Tet& tet = body.model.mesh.tets[t];
  Corners c = corners_of(tet, body.state.x);
  for (int a = 0; ahead && a < 4; ++a) c.col(a) += body.dx_free.segment<3>(3 * tet[a]);
  return (c.col(1) - c.col(0)).cross(c.col(2) - c.col(0)).dot(c.col(3) - c.col(0));
}

}  // namespace

bool can_look_ahead(const Body& body) {
  const Within free_motion(body.times, StepPart::free_motion);
  if (body.model.material.law == Law::guarded) return false;
  for (int t = 0; t < body.model.tet_count(); ++t)
    if (body.state.alive[t] && !(volume(body, t, false) > 0 && volume(body, t, true) > 0)) return false;
  return true;
}

void linearise_ahead(Body& body, double h) {
  const Within free_motion(body.times, StepPart::free_motion);
  const TissueModel& m = body.model;
  TissueState& state = body.state;
  const std::vector<Vec3> x = state.x;
  body.dx_ahead = body.dx_free;
  for (int n = 0; n < m.node_count(); ++n) state.x[n] += body.dx_free.segment<3>(3 * n);
  {
    const Within assembly(body.times, StepPart::assembly);
    update_rotations(m, state);
  }
  body.compliance->update(state);

  VecX f(body.dx_free.size());
  internal_forces(m, state, f);
  external_forces(m, state, body.scratch);
  f += body.scratch;
  if (m.dynamic) {
    const Material& material = m.material;
    if (material.rayleigh_stiffness > 0)
      subtract_stiffness(body, body.dx_free, material.rayleigh_stiffness / h, f);
    const double per_mass = 1 / (h * h) + material.rayleigh_mass / h;
    for (int n = 0; n < m.node_count(); ++n)
      f.segment<3>(3 * n) += state.mass[n] * (state.v[n] / h - per_mass * body.dx_free.segment<3>(3 * n));
  }
  for (int n = 0; n < m.node_count(); ++n)
    if (m.fixed[n] || state.live_tets_of_node[n] == 0) f.segment<3>(3 * n).setZero();
  body.compliance->apply(f, f);
  body.dx_free += f;
  state.x = x;
}

}  // namespace hapticd
