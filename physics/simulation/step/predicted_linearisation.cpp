#include "physics/simulation/step/predicted_linearisation.h"

namespace hapticd {

bool can_predict_linearisation(const Body& body) {
  const Within free_motion(body.times, StepPart::free_motion);
  if (body.model.material.law == Law::guarded) return false;
  return least_volume(body.model, body.state, nullptr) > 0 &&
         least_volume(body.model, body.state, &body.free.dx) > 0;
}

void linearise_ahead(Body& body, double h) {
  const Within free_motion(body.times, StepPart::free_motion);
  const TissueModel& m = body.model;
  TissueState& state = body.state;
  const std::vector<Vec3> x = state.x;
  body.free.predicted = body.free.dx;
  m.each_node([&](int n) { state.x[n] += body.free.dx.segment<3>(3 * n); });
  {
    const Within assembly(body.times, StepPart::assembly);
    update_rotations(m, state);
  }
  body.compliance->update(state);

  VecX f(body.free.dx.size());
  internal_forces(m, state, body.free.dx, m.dynamic ? m.material.rayleigh_stiffness / h : 0, f);
  external_forces(m, state, body.scratch.force);
  f += body.scratch.force;
  if (m.dynamic) {
    const double per_mass = 1 / (h * h) + m.material.rayleigh_mass / h;
    m.each_node([&](int n) {
      f.segment<3>(3 * n) += state.mass[n] * (state.v[n] / h - per_mass * body.free.dx.segment<3>(3 * n));
    });
  }
  m.each_node([&](int n) {
    if (m.fixed[n] || state.live_tets_of_node[n] == 0) f.segment<3>(3 * n).setZero();
  });
  begin_free_motion(body, f, &body.free.predicted);
  state.x = x;
}

}  // namespace hapticd
