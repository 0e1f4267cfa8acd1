#include "physics/simulation/step/predicted_linearisation.h"

namespace hapticd {

bool can_predict_linearisation(const Body& body) {
  const Within free_motion(body.times, StepPart::free_motion);
  if (body.model.material.law == Law::guarded) return false;
  return least_volume(body.model, body.state, nullptr) > 0 &&
         least_volume(body.model, body.state, &body.dx_free) > 0;
}

void linearise_ahead(Body& body, double h) {
  const Within free_motion(body.times, StepPart::free_motion);
  const TissueModel& m = body.model;
  TissueState& state = body.state;
  const std::vector<Vec3> x = state.x;
  body.dx_predicted = body.dx_free;
  for (int n = 0; n < m.node_count(); ++n) state.x[n] += body.dx_free.segment<3>(3 * n);
  {
    const Within assembly(body.times, StepPart::assembly);
    update_rotations(m, state);
  }
  body.compliance->update(state);

  VecX f(body.dx_free.size());
  internal_forces(m, state, body.dx_free, m.dynamic ? m.material.rayleigh_stiffness / h : 0, f);
  external_forces(m, state, body.scratch);
  f += body.scratch;
  if (m.dynamic) {
    const double per_mass = 1 / (h * h) + m.material.rayleigh_mass / h;
    for (int n = 0; n < m.node_count(); ++n)
      f.segment<3>(3 * n) += state.mass[n] * (state.v[n] / h - per_mass * body.dx_free.segment<3>(3 * n));
  }
  for (int n = 0; n < m.node_count(); ++n)
    if (m.fixed[n] || state.live_tets_of_node[n] == 0) f.segment<3>(3 * n).setZero();
  begin_free_motion(body, f, &body.dx_predicted);
  state.x = x;
}

}  // namespace hapticd
