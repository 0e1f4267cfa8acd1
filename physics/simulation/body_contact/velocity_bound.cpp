#include "physics/simulation/body_contact/velocity_bound.h"

#include <algorithm>
#include <cmath>

#include "physics/tissue/stored_energy.h"

namespace hapticd {
namespace {

constexpr double notable = 1e-4;      // of the energies: as free_motion.cpp
constexpr double solve_error = 1e-9;  // … as energy_bound.cpp

VecX energies(const Body& body, const VecX& dx) {
  VecX E(body.energy.pieces.count());
  stored_energies(body.model, body.state, body.energy.pieces, dx, E);
  return E;
}

template <typename Visit>
void each_node(const Body& body, const Visit& visit) {
  for (int n = 0; n < body.model.node_count(); ++n)
    if (const int p = body.energy.pieces.of_node[n]; p >= 0 && !body.model.fixed[n]) visit(n, p);
}

void move(Body& body, double h) {
  body.corrected.v_before = body.state.v;
  for (int n = 0; n < body.model.node_count(); ++n) {
    body.state.x[n] += body.free.dx.segment<3>(3 * n);
    body.state.v[n] = body.free.dx.segment<3>(3 * n) / h;
  }
}

// Sums over the nodes of each piece.
struct PieceMotion {
  VecX mass, work, before, relative;  // [kg], fᵀΔx, ½ m v², ½ m ‖Δx/h − v̄‖² [J]
  MatX mean;                          // v̄: 3 a piece

  PieceMotion(const Body& body, const VecX& force, double h) {
    const int count = body.energy.pieces.count();
    mass = work = before = relative = VecX::Zero(count);
    mean = MatX::Zero(3, count);
    each_node(body, [&](int n, int p) {
      const Vec3 dx = body.free.dx.segment<3>(3 * n);
      mass[p] += body.state.mass[n];
      mean.col(p) += body.state.mass[n] / h * dx;
      work[p] += force.segment<3>(3 * n).dot(dx);
      before[p] += 0.5 * body.state.mass[n] * body.state.v[n].squaredNorm();
    });
    for (int p = 0; p < count; ++p)
      mean.col(p) *= body.energy.pieces.held[p] || !(mass[p] > 0) ? 0 : 1 / mass[p];
    each_node(body, [&](int n, int p) {
      relative[p] +=
          0.5 * body.state.mass[n] * (body.free.dx.segment<3>(3 * n) / h - mean.col(p)).squaredNorm();
    });
  }
};

}  // namespace

void correct_touching(Body& body, const VecX& contact_force, std::span<const int> near, double h,
                      const VecX* response) {
  const Within free_motion(body.times, StepPart::free_motion);
  finish_free_motion(body, response || contact_force.isZero(0) ? nullptr : &contact_force);
  if (response) body.free.dx += *response;
  body.corrected.force = contact_force;
  EnergyLedger& e = body.energy;
  if (e.elastic.size() == 0) {
    e.pieces = find_pieces(body.model, body.state);
    e.elastic = energies(body, VecX::Zero(body.free.dx.size()));
  }
  external_forces(body.model, body.state, body.scratch.force);
  VecX kept = body.free.dx;
  EnergyBound bound =
      bound_energy(body.model, body.state, e.pieces, e.elastic, kept, {body.scratch.force, contact_force}, h);
  if (!(bound.made > 0)) {
    e.elastic = std::move(bound.elastic);
    e.bounded_steps = 0;
    return move(body, h);
  }
  // Whole is the motion of pieces that are near others; of the rest, what the bound keeps.
  std::vector<std::uint8_t> whole(e.pieces.count(), 0);
  for (const int n : near)
    if (const int p = e.pieces.of_node[n]; p >= 0) whole[p] = 1;
  each_node(body, [&](int n, int p) {
    if (!whole[p]) body.free.dx.segment<3>(3 * n) = kept.segment<3>(3 * n);
  });
  const PieceMotion motion(body, body.scratch.force + contact_force, h);
  const VecX before = e.elastic;
  e.elastic = energies(body, body.free.dx);
  move(body, h);

  VecX share = VecX::Ones(e.pieces.count());
  for (int p = 0; p < e.pieces.count(); ++p) {
    const double allowed = before[p] + motion.before[p] + motion.work[p];
    const double scale = before[p] + motion.before[p] + std::abs(motion.work[p]);
    const double of_mean = 0.5 * motion.mass[p] * motion.mean.col(p).squaredNorm();
    const double excess = e.elastic[p] + of_mean + motion.relative[p] - allowed;
    if (whole[p] && excess > solve_error * scale)
      share[p] = motion.relative[p] > excess ? std::sqrt(1 - excess / motion.relative[p]) : 0;
  }
  each_node(body, [&](int n, int p) {
    if (share[p] < 1)
      body.state.v[n] = motion.mean.col(p) + share[p] * (body.state.v[n] - motion.mean.col(p));
  });
  e.bounded_steps = bound.made > notable ? e.bounded_steps + 1 : 0;
}

}  // namespace hapticd
