#include "physics/simulation/body.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "physics/simulation/step/energy_bound.h"
#include "physics/tissue/stored_energy.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

constexpr double sleeping_speed = 1e-5;  // [m/s]

constexpr double far_turn = 0.3;    // [rad] in a step
constexpr double notable = 1e-4;   // of the energies: more than a rounded factor makes

// Δx_free, where `dx_free` holds f_int so far.
void free_motion_of_force(Body& body, double h) {
  external_forces(body.model, body.state, body.scratch);
  body.dx_free += body.scratch;
  for (int n = 0; body.model.dynamic && n < body.model.node_count(); ++n)
    if (!body.model.fixed[n] && body.state.live_tets_of_node[n] > 0)
      body.dx_free.segment<3>(3 * n) += body.state.mass[n] / h * body.state.v[n];
  begin_free_motion(body, body.dx_free, nullptr);
}

// In f_int, the force of a tetrahedron: that of the factor's own linear law, R sym(RᵀF), instead of the
// present.
void keep_factored_rotation(Body& body, int t) {
  const TissueModel& m = body.model;
  const Tet& tet = m.mesh.tets[t];
  const Mat3 F = deformation_gradient(corners_of(tet, body.state.x), m.gradients[t]);
  const Mat3& R = body.factored_rotation[t];
  const Mat3 A = R.transpose() * F;
  const double mu = m.material.mu(), lambda = m.material.lambda();
  const Corners change =
      element_forces(0.5 * R * (A + A.transpose()), R, m.gradients[t], m.volume[t], mu, lambda) -
      element_forces(F, body.state.rotation[t], m.gradients[t], m.volume[t], mu, lambda);
  for (int a = 0; a < 4; ++a)
    if (!m.fixed[tet[a]]) body.dx_free.segment<3>(3 * tet[a]) += change.col(a);
}

// u = C f_ext is all there is to solve for, once: the compliance of a linear static body never changes.
void compute_free_displacement(Body& body) {
  body.forward_solved = false;
  if (body.under_load.size() == 0) {
    body.under_load = VecX::Zero(body.dx_free.size());
    external_forces(body.model, body.state, body.scratch);
    if (!body.scratch.isZero(0)) body.compliance->apply(body.scratch, body.under_load);
  }
  for (int n = 0; n < body.model.node_count(); ++n)
    body.dx_free.segment<3>(3 * n) = body.rest[n] + body.under_load.segment<3>(3 * n) - body.state.x[n];
}

void keep_energy(Body& body, double h) {
  external_forces(body.model, body.state, body.scratch);
  body.scratch += body.pressed;
  if (body.elastic.size() == 0) {
    body.pieces = find_pieces(body.model, body.state);
    body.elastic.resize(body.pieces.count());
    stored_energies(body.model, body.state, body.pieces, VecX::Zero(body.dx_free.size()), body.elastic);
  }
  EnergyBound bound =
      bound_energy(body.model, body.state, body.pieces, body.elastic, body.dx_free, body.scratch, h);
  body.elastic = std::move(bound.elastic);
  body.bounded_steps = bound.made > notable ? body.bounded_steps + 1 : 0;
}

TissueModel model_of(BodySettings& s, const Vec3& gravity) {
  TissueModel model;
  if (s.deformable) {
    model = make_tissue_model(std::move(s.mesh), s.material, s.fixed_nodes, gravity);
    model.corotational = s.corotational;
    model.dynamic = s.dynamic;
    return model;
  }
  model.mesh = std::move(s.mesh);
  return model;
}

double mean_edge(const TetMesh& mesh) {
  double sum = 0;
  for (const Tet& t : mesh.tets)
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < a; ++b) sum += (mesh.nodes[t[a]] - mesh.nodes[t[b]]).norm();
  return mesh.tets.empty() ? 0 : sum / (6 * static_cast<double>(mesh.tets.size()));
}

TissueState state_of(const TissueModel& model, bool deformable) {
  if (deformable) return rest_state(model);
  TissueState state;
  state.x = model.mesh.nodes;
  return state;
}

}  // namespace

Body::Body(BodySettings settings, double h, const Vec3& gravity, ComplianceMethod method,
           const ComplianceOptions& options)
    : name(std::move(settings.name)),
      deformable(settings.deformable),
      friction(settings.friction),
      removable(settings.removable),
      model(model_of(settings, gravity)),
      state(state_of(model, deformable)),
      surface(model.mesh),
      references(nullptr),
      rest(model.mesh.nodes) {
  if (removable && !deformable) throw std::invalid_argument(name + ": a rigid body cannot be removable");
  if (removable && !model.dynamic)
    throw std::invalid_argument(name +
                                ": a static body cannot be removable: pieces cut loose need their mass");
  edge = mean_edge(model.mesh);
  if (!deformable) return;
  compliance = make_compliance(method, model, h, options);
  references = as_reference_compliance(compliance.get());
  dx_free = VecX::Zero(3 * model.node_count());
  scratch = dx_free;
  times = options.times;
}

bool at_rest(const Body& body) {
  return body.bounded_steps == 0 && std::all_of(body.state.v.begin(), body.state.v.end(), [](const Vec3& v) {
           return v.squaredNorm() < sleeping_speed * sleeping_speed;
         });
}

void compute_free_motion(Body& body, double h) {
  const Within free_motion(body.times, StepPart::free_motion);
  if (!body.model.corotational && !body.model.dynamic) return compute_free_displacement(body);
  internal_forces(body.model, body.state, body.dx_free);
  free_motion_of_force(body, h);
}

void fresh_free_motion(Body& body, double h) {
  if (!body.model.corotational) return compute_free_motion(body, h);
  const Within free_motion(body.times, StepPart::free_motion);
  std::vector<int> far;
  {
    const Within assembly(body.times, StepPart::assembly);
    update_rotations(body.model, body.state, body.factored_rotation, far_turn, far);
  }
  internal_forces(body.model, body.state, body.dx_free);
  for (const int t : far) keep_factored_rotation(body, t);
  free_motion_of_force(body, h);
}

void foresee_free_motion(Body& body, double h) {
  const Within free_motion(body.times, StepPart::free_motion);
  const TissueModel& m = body.model;
  const double s = m.dynamic ? 1 + m.material.rayleigh_stiffness / h : 1;
  const double per_mass = (1 / (h * h) + m.material.rayleigh_mass / h) / s;
  VecX b = -body.pressed;
  for (int n = 0; m.dynamic && n < m.node_count(); ++n)
    b.segment<3>(3 * n) += body.state.mass[n] * ((body.state.v[n] - body.v_before[n]) / h +
                                                 per_mass * body.dx_free.segment<3>(3 * n));
  const VecX from = (1 - 1 / s) * body.dx_free;
  begin_free_motion(body, b, &from);
}

void begin_free_motion(Body& body, const VecX& b, const VecX* from) {
  Solved solved = Solved::whole;
  if (body.references)
    solved = body.references->start_solve(b, body.dx_free);
  else
    body.compliance->apply(b, body.dx_free);
  body.in_halves = body.forward_solved = solved == Solved::forward;
  if (from)
    body.forward_offset = *from;
  else
    body.forward_offset.resize(0);
  if (from) body.dx_free += body.forward_offset;
}

void finish_free_motion(Body& body, const VecX* f) {
  if (body.forward_solved) {
    if (!f) body.scratch.setZero();
    body.references->finish_solve(f ? *f : body.scratch, body.dx_free);
    if (body.forward_offset.size() > 0) body.dx_free += body.forward_offset;
    body.forward_solved = false;
  } else if (f) {
    body.compliance->apply(*f, body.scratch);
    body.dx_free += body.scratch;
  }
}

void know_free_motion(Body& body, std::span<const int> nodes) {
  if (body.forward_solved && !body.references->forward_covers(nodes)) finish_free_motion(body, nullptr);
}

void correct(Body& body, const VecX* contact_force, double h, bool keeps_energy) {
  const Within free_motion(body.times, StepPart::free_motion);
  finish_free_motion(body, contact_force);
  if (contact_force)
    body.pressed = *contact_force;
  else
    body.pressed.setZero(body.dx_free.size());
  if (keeps_energy && body.model.dynamic) keep_energy(body, h);
  body.v_before.swap(body.state.v);
  body.state.v.resize(body.v_before.size());
  for (int n = 0; n < body.model.node_count(); ++n) {
    body.state.x[n] += body.dx_free.segment<3>(3 * n);
    body.state.v[n] = body.dx_free.segment<3>(3 * n) / h;
  }
}

std::vector<int> take_out(Body& body, std::span<const int> tets) {
  std::vector<int> went;
  for (const int t : tets)
    if (body.state.alive[t] && std::find(went.begin(), went.end(), t) == went.end()) went.push_back(t);
  body.surface.remove(tets);
  body.asleep = false;
  remove_tets(body.model, body.state, went);
  if (!went.empty()) body.elastic.resize(0);
  return went;
}

int remove_from(Body& body, std::span<const int> tets) {
  const std::vector<int> went = take_out(body, tets);
  if (!went.empty()) body.compliance->remove(body.state, went);
  return static_cast<int>(went.size());
}

}  // namespace hapticd
