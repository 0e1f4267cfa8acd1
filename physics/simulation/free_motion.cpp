#include "physics/simulation/free_motion.h"

#include <utility>

#include "physics/simulation/body.h"
#include "physics/tissue/stored_energy.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

constexpr double far_turn = 0.3;  // [rad] in a step
constexpr double notable = 1e-4;  // of the energies: more than a rounded factor makes
constexpr double little = 0.1;    // of a motion: where no more is kept, its direction was wrong

// Δx_free, where `free.dx` holds f_int so far.
void free_motion_of_force(Body& body, double h) {
  external_forces(body.model, body.state, body.scratch.force);
  body.free.dx += body.scratch.force;
  if (body.model.dynamic)
    body.model.each_node([&](int n) {
      if (!body.model.fixed[n] && body.state.live_tets_of_node[n] > 0)
        body.free.dx.segment<3>(3 * n) += body.state.mass[n] / h * body.state.v[n];
    });
  begin_free_motion(body, body.free.dx, nullptr);
}

// In f_int, the force of a tetrahedron: that of the factor's own linear law, R sym(RᵀF), instead of the
// present.
void keep_factored_rotation(Body& body, int t) {
  const TissueModel& m = body.model;
  const Tet& tet = m.mesh.tets[t];
  const Mat3 F = deformation_gradient(corners_of(tet, body.state.x), m.gradients[t]);
  const Mat3& R = body.scratch.factored_rotation[t];
  const Mat3 A = R.transpose() * F;
  const auto [mu, lambda, density] = m.elastic[t];
  const double volume = volume_left(m, body.state, t);
  const Corners change =
      element_forces(0.5 * R * (A + A.transpose()), R, m.gradients[t], volume, mu, lambda) -
      element_forces(F, body.state.rotation[t], m.gradients[t], volume, mu, lambda);
  for (int a = 0; a < 4; ++a)
    if (!m.fixed[tet[a]]) body.free.dx.segment<3>(3 * tet[a]) += change.col(a);
}

// u = C f_ext is all there is to solve for, once: the compliance of a linear static body never changes.
void compute_free_displacement(Body& body) {
  body.free.forward_solved = false;
  if (body.free.under_load.size() == 0) {
    body.free.under_load = VecX::Zero(body.free.dx.size());
    external_forces(body.model, body.state, body.scratch.force);
    if (!body.scratch.force.isZero(0)) body.compliance->apply(body.scratch.force, body.free.under_load);
  }
  for (int n = 0; n < body.model.node_count(); ++n)
    body.free.dx.segment<3>(3 * n) =
        body.rest()[n] + body.free.under_load.segment<3>(3 * n) - body.state.x[n];
}

void keep_energy(Body& body, double h) {
  EnergyLedger& e = body.energy;
  external_forces(body.model, body.state, body.scratch.force);
  if (e.elastic.size() == 0) {
    e.pieces = find_pieces(body.model, body.state);
    e.elastic.resize(e.pieces.count());
    stored_energies(body.model, body.state, e.pieces, VecX::Zero(body.free.dx.size()), e.elastic);
  }
  EnergyBound bound = bound_energy(body.model, body.state, e.pieces, e.elastic, body.free.dx,
                                   {body.scratch.force, body.corrected.force}, h);
  e.elastic = std::move(bound.elastic);
  e.bounded_steps = bound.made > notable || bound.share < little ? e.bounded_steps + 1 : 0;
}

}  // namespace

void compute_free_motion(Body& body, double h) {
  const Within free_motion(body.times, StepPart::free_motion);
  if (!body.model.corotational && !body.model.dynamic) return compute_free_displacement(body);
  internal_forces(body.model, body.state, body.free.dx);
  free_motion_of_force(body, h);
}

void fresh_free_motion(Body& body, double h) {
  if (!body.model.corotational) return compute_free_motion(body, h);
  const Within free_motion(body.times, StepPart::free_motion);
  std::vector<int> far;
  {
    const Within assembly(body.times, StepPart::assembly);
    update_rotations(body.model, body.state, body.scratch.factored_rotation, far_turn, far);
  }
  internal_forces(body.model, body.state, body.free.dx);
  for (const int t : far) keep_factored_rotation(body, t);
  free_motion_of_force(body, h);
}

// Of A Δx = M v/h + f_ext + f_int + f, with s = 1 + β/h:
//
//   Δx_free = (1 − 1/s) Δx + C (M ((v⁺ − v)/h + (1/h² + α/h) Δx/s) − f)
void foresee_free_motion(Body& body, double h) {
  const Within free_motion(body.times, StepPart::free_motion);
  const TissueModel& m = body.model;
  const double s = m.dynamic ? 1 + m.material.rayleigh_stiffness / h : 1;
  const double per_mass = (1 / (h * h) + m.material.rayleigh_mass / h) / s;
  VecX b = -body.corrected.force;
  if (m.dynamic)
    m.each_node([&](int n) {
      b.segment<3>(3 * n) += body.state.mass[n] * ((body.state.v[n] - body.corrected.v_before[n]) / h +
                                                   per_mass * body.free.dx.segment<3>(3 * n));
    });
  const VecX from = (1 - 1 / s) * body.free.dx;
  begin_free_motion(body, b, &from);
}

void begin_free_motion(Body& body, const VecX& b, const VecX* from) {
  Solved solved = Solved::whole;
  if (body.references)
    solved = body.references->start_solve(b, body.free.dx);
  else
    body.compliance->apply(b, body.free.dx);
  body.free.in_halves = body.free.forward_solved = solved == Solved::forward;
  if (from)
    body.free.offset = *from;
  else
    body.free.offset.resize(0);
  if (from) body.free.dx += body.free.offset;
}

void finish_free_motion(Body& body, const VecX* f) {
  if (body.free.forward_solved) {
    if (!f) body.scratch.force.setZero();
    body.references->finish_solve(f ? *f : body.scratch.force, body.free.dx);
    if (body.free.offset.size() > 0) body.free.dx += body.free.offset;
    body.free.forward_solved = false;
  } else if (f) {
    body.compliance->apply(*f, body.scratch.force);
    body.free.dx += body.scratch.force;
  }
}

void know_free_motion(Body& body, std::span<const int> nodes) {
  if (body.free.forward_solved && !body.references->forward_covers(nodes)) finish_free_motion(body, nullptr);
}

void correct(Body& body, const VecX* contact_force, double h, bool keeps_energy, const VecX* response) {
  const Within free_motion(body.times, StepPart::free_motion);
  finish_free_motion(body, response ? nullptr : contact_force);
  if (response) body.free.dx += *response;
  if (contact_force)
    body.corrected.force = *contact_force;
  else
    body.corrected.force.setZero(body.free.dx.size());
  if (keeps_energy && body.model.dynamic) keep_energy(body, h);
  body.corrected.v_before.swap(body.state.v);
  body.state.v.resize(body.corrected.v_before.size(), Vec3::Zero());
  body.model.each_node([&](int n) {
    body.state.x[n] += body.free.dx.segment<3>(3 * n);
    body.state.v[n] = body.free.dx.segment<3>(3 * n) / h;
  });
}

}  // namespace hapticd
