// Coupling: it enters W as J K_eff⁻¹ Jᵀ, and the free instrument pose is X_device ⊖ K_eff⁻¹ (B/T) e_prev. Virtual
// work fixes the wrench's sign.
//
// Missed contacts: what no row holds may spring through the instrument, where normals point out on its wrong side.
// So a solve that leaves a sample deeper than `margin`, or one that was nearer than `margin` at all inside, is
// repeated at its own linearisation with that sample's rows.
//
// Sticking is judged by slip, ‖δ_t‖ ≤ 1e-6 · tr W_ii/3 · ‖λ_i‖, or by λ being inside its cone; a slip below that
// adds up until it shows. An anchor that stays keeps holding still from creeping.
//
// Resumed solves: where one with friction ends at a cap or its deadline, Newton's unfinished steps may be anything,
// and it would end there again in the next tick. So until turns alone solve one, or 200 were usable, solves have one
// linearisation and take turns of what nears the solution from wherever it starts: normal forces for the friction
// there is (lcp.h), then sweeps; with time left, the whole solver. What they reach is remembered, usable or not.
#include "physics/contact/contact_solve.h"

#include <algorithm>
#include <cmath>

#include "physics/contact/contact_pairs.h"
#include "physics/contact/missed_contact.h"

namespace hapticd {
namespace {

constexpr int most_returns = 3;      // to a linearisation whose solve let tissue through
constexpr int solves_resumed = 200;  // after one that ended unusable
constexpr double doubtful = 0.01;    // of the usable residual: Newton's sum of forces is not to be trusted
constexpr int turns_resumed = 8;     // at most, of normal forces and sweeps
constexpr int sweeps_in_a_turn = 2;  // more, and the solver would try from zero

std::span<const double> solved(const ContactScratch& scratch) noexcept {
  return {scratch.lambda.data(), static_cast<std::size_t>(scratch.rows.rows())};
}

Vec3 local_lambda(const ContactScratch& scratch, int i) noexcept {
  Vec3 l = Vec3::Zero();
  const int m = scratch.rows.rows_per_contact;
  for (int c = 0; c < m; ++c) l[c] = scratch.lambda[m * i + c];
  return l;
}

void warm_start(const ContactMemory& memory, ContactScratch& scratch) noexcept {
  const int m = scratch.rows.rows_per_contact;
  for (int i = 0; i < scratch.rows.contacts; ++i) {
    const ContactRow& row = scratch.rows.row[i];
    const ContactMemory::Entry* known = memory.find(row.id, row.primitive);
    const Vec3 l = known ? Vec3(row.frame.transpose() * known->lambda) : Vec3::Zero();
    for (int c = 0; c < m; ++c) scratch.lambda[m * i + c] = l[c];
    scratch.active[i] = l[0] > 0;
    scratch.mu[i] = row.friction;
  }
}

// Normal forces for the friction there is; friction stays in its cone.
void solve_normals(const ContactOptions& options, ContactScratch& scratch) noexcept {
  const ContactRows& rows = scratch.rows;
  const int n = rows.contacts;
  const auto W = rows.W();
  Eigen::Map<MatX> W_nn(scratch.normal_W.data(), n, n);
  Eigen::Map<VecX> q_n(scratch.normal_q.data(), n), z(scratch.normal_lambda.data(), n);
  for (int i = 0; i < n; ++i) {
    z[i] = scratch.lambda[3 * i];
    scratch.active[i] = z[i] > 0;
    q_n[i] = rows.q()[3 * i];
  }
  for (int j = 0; j < n; ++j) {
    const Vec3 l = local_lambda(scratch, j);
    for (int i = 0; i < n; ++i) {
      W_nn(i, j) = W(3 * i, 3 * j);
      q_n[i] += W(3 * i, 3 * j + 1) * l[1] + W(3 * i, 3 * j + 2) * l[2];
    }
  }
  LcpOptions lcp = options.lcp;
  lcp.deadline = options.deadline;
  const LcpResult r =
      solve_lcp(W_nn, q_n, z, {scratch.active.data(), static_cast<std::size_t>(n)}, scratch.lcp, 0, lcp);
  if (r.status != SolveStatus::solved) return;
  for (int i = 0; i < n; ++i) {
    Eigen::Map<Vec3> l(scratch.lambda.data() + 3 * i);
    l[0] = z[i];
    const double t = l.tail<2>().norm(), most = scratch.mu[i] * l[0];
    if (t > most) l.tail<2>() *= most / t;
  }
}

void resume(const ContactOptions& options, ContactScratch& scratch, ContactSolution& out) noexcept {
  const ContactRows& rows = scratch.rows;
  Eigen::Map<VecX> lambda(scratch.lambda.data(), rows.rows());
  const std::span<const double> mu{scratch.mu.data(), static_cast<std::size_t>(rows.contacts)};
  CoulombOptions whole = options.coulomb;
  whole.deadline = options.deadline;
  CoulombOptions sweeps = whole;
  sweeps.max_newton = 0;
  sweeps.max_sweeps = std::min(sweeps_in_a_turn, sweeps.max_sweeps);
  const auto solve = [&](const CoulombOptions& o) {
    const CoulombResult r =
        solve_coulomb(rows.W(), rows.q(), mu, lambda, scratch.coulomb, scratch.matrix_version, o);
    out.status = r.status;
    out.residual = r.residual;
    out.near = out.near || r.sweeps > 0;
    return r.status == SolveStatus::solved || r.status == SolveStatus::not_finite;
  };
  for (int turn = 0; turn < turns_resumed; ++turn) {
    if (!options.deadline.passed()) solve_normals(options, scratch);
    if (solve(sweeps) || options.deadline.passed()) return;
  }
  // With time left, the whole solver; what the turns reached stays if that does not end.
  const ContactSolution reached = out;
  std::copy_n(scratch.lambda.begin(), rows.rows(), scratch.resumed_lambda.begin());
  if (solve(whole)) {
    out.laboured = true;
    return;
  }
  std::copy_n(scratch.resumed_lambda.begin(), rows.rows(), scratch.lambda.begin());
  out = reached;
}

// later: linearisations after this one.
void solve_rows(const ContactOptions& options, int later, bool resumed, ContactScratch& scratch,
                ContactSolution& out) noexcept {
  const Within solve(options.times, ContactPart::solve);
  Deadline deadline = options.deadline;
  if (deadline.bounded() && later > 0) deadline.reserve_ns += std::max<std::int64_t>(0, deadline.left() / 2);
  const ContactRows& rows = scratch.rows;
  const auto contacts = static_cast<std::size_t>(rows.contacts);
  Eigen::Map<VecX> lambda(scratch.lambda.data(), rows.rows());
  if (rows.rows_per_contact == 1) {
    LcpOptions lcp = options.lcp;
    lcp.deadline = deadline;
    const LcpResult r = solve_lcp(rows.W(), rows.q(), lambda, {scratch.active.data(), contacts}, scratch.lcp,
                                  scratch.matrix_version, lcp);
    out.status = r.status;
    out.residual = r.residual;
  } else if (resumed) {
    resume(options, scratch, out);
  } else {
    CoulombOptions coulomb = options.coulomb;
    coulomb.deadline = deadline;
    const CoulombResult r = solve_coulomb(rows.W(), rows.q(), {scratch.mu.data(), contacts}, lambda,
                                          scratch.coulomb, scratch.matrix_version, coulomb);
    out.status = r.status;
    out.residual = r.residual;
  }
}

// λ in world axes, and the anchors that the rows were built with.
void remember_linearisation(ContactScratch& scratch) noexcept {
  scratch.working.count = scratch.rows.contacts;
  for (int i = 0; i < scratch.rows.contacts; ++i) {
    const ContactRow& row = scratch.rows.row[i];
    scratch.working.entry[i] = {row.id, row.frame * local_lambda(scratch, i), row.anchor, false, row.primitive};
  }
}

bool sticks(const ContactScratch& scratch, int i) noexcept {
  const ContactRows& rows = scratch.rows;
  const Vec3 l = local_lambda(scratch, i);
  const double mu = rows.row[i].friction;
  if (rows.rows_per_contact == 1 || mu <= 0 || l[0] <= 0) return false;
  if (l.tail<2>().norm() <= inside_the_cone * mu * l[0]) return true;
  const auto W = rows.W();
  const Eigen::Map<const VecX> lambda(scratch.lambda.data(), rows.rows());
  // W is symmetric: its columns are its rows, and contiguous.
  const int t = 3 * i + 1;
  const Eigen::Vector2d slip = W.middleCols<2>(t).transpose() * lambda + rows.q().segment<2>(t);
  return slip.norm() <= sticking_slip * W.block<3, 3>(3 * i, 3 * i).trace() / 3 * l.norm();
}

// Memory of the solve for the next one. `place` gives a sample's place in the instrument's frame.
template <typename Place>
void remember_solve(const CondensedProblem& problem, ContactScratch& scratch, ContactMemory& memory,
                    const Place& place) noexcept {
  remember_linearisation(scratch);
  for (int i = 0; i < scratch.rows.contacts; ++i) {
    ContactMemory::Entry& e = scratch.working.entry[i];
    e.sticking = sticks(scratch, i);
    const ContactRow& row = scratch.rows.row[i];
    if (!e.sticking) e.anchor = place(row, sample_position(problem, scratch.x, row.sample));
  }
  memory = scratch.working;
}

// Whether it is to be remembered.
bool serves(const ContactOptions& options, const ContactSolution& out) noexcept {
  return out.near || out.status == SolveStatus::solved || out.residual <= options.usable_residual;
}

void solve_frozen(const CondensedProblem& problem, const Instrument& instrument, const Pose& X_free,
                  const Vec6& K_inv, double margin, const ContactOptions& options, ContactState& state,
                  ContactScratch& scratch, ContactSolution& out) noexcept {
  if (problem.step == 0 || state.frozen_step != problem.step || scratch.matrix_version == 0) {
    build_rows(problem, instrument, problem.X_ref, problem.X_ref, problem.x_now, K_inv, state.memory, margin,
               scratch.rows, nullptr, options.times);
    ++scratch.matrix_version;
    state.frozen_step = problem.step;
  }
  shift_rows(problem, problem.X_ref, X_free, state.memory, scratch.rows);
  warm_start(state.memory, scratch);
  solve_rows(options, 0, state.resumed > 0, scratch, out);
  displaced_patch(problem, scratch.rows, solved(scratch), scratch.x);
  out.wrench = wrench_on_instrument(scratch.rows, solved(scratch));
  out.instrument = displaced(X_free, K_inv.cwiseProduct(out.wrench));
  // Anchors in the frozen rows' own linear kinematics, or a pose held still would seem to slip.
  const Vec6 moved = difference(out.instrument, problem.X_ref);
  if (serves(options, out))
    remember_solve(problem, scratch, state.memory, [&](const ContactRow& row, const Vec3& s) {
      return problem.X_ref.to_local(s - moved.head<3>() - moved.tail<3>().cross(row.arm));
    });
}

void solve_renewed(const CondensedProblem& problem, const Instrument& instrument, const Pose& X_free,
                   const Pose& X_start, const Vec6& K_inv, double margin, const ContactOptions& options,
                   ContactState& state, ContactScratch& scratch, ContactSolution& out) noexcept {
  scratch.working = state.memory;
  displaced_patch(problem, state.memory, scratch.x);
  out.instrument = X_start;
  const int linearisations = state.resumed > 0 ? 1 : std::max(1, options.linearisations);
  const double activation =
      options.activation_distance > 0 ? std::min(options.activation_distance, margin) : margin;
  PatchPositions x_lin;
  Pose X_lin;
  const auto build = [&](const Reached* reached) {
    build_rows(problem, instrument, X_free, X_lin, x_lin, K_inv, scratch.working, activation, scratch.rows,
               reached, options.times);
    ++scratch.matrix_version;
  };
  // False if the solver met no number.
  const auto solve = [&](int later) {
    warm_start(scratch.working, scratch);
    solve_rows(options, later, state.resumed > 0, scratch, out);
    if (out.status == SolveStatus::not_finite) return false;
    displaced_patch(problem, scratch.rows, solved(scratch), scratch.x);
    out.wrench = wrench_on_instrument(scratch.rows, solved(scratch));
    out.instrument = displaced(X_free, K_inv.cwiseProduct(out.wrench));
    remember_linearisation(scratch);
    return true;
  };
  for (int k = 0; k < linearisations; ++k) {
    if (k > 0 && options.deadline.passed()) {
      out.status = SolveStatus::deadline;
      break;
    }
    x_lin = scratch.x;
    X_lin = out.instrument;
    build(nullptr);
    if (!solve(linearisations - 1 - k)) return;
    for (int again = 0; again < most_returns && !options.deadline.passed(); ++again) {
      const Reached end{scratch.x, out.instrument};
      if (!violates_inactive_contact(problem, instrument, X_lin, x_lin, activation, margin, end)) break;
      build(&end);
      if (!solve(linearisations - 1 - k)) return;
    }
  }
  if (serves(options, out))
    remember_solve(problem, scratch, state.memory,
                   [&](const ContactRow&, const Vec3& s) { return out.instrument.to_local(s); });
}

double deepest_overlap(const CondensedProblem& problem, const Instrument& instrument, const Pose& X,
                       const ContactScratch& scratch, double& lost) noexcept {
  double deepest = 0;
  const ContactRows& rows = scratch.rows;
  int row = 0;  // rows are by sample, then primitive
  lost = 0;
  const PlacedInstrument placed(instrument, X);
  for (int k = 0; k < problem.samples; ++k) {
    const Vec3 s = sample_position(problem, scratch.x, k);
    while (row < rows.contacts && rows.row[row].sample < k) ++row;
    int end = row;
    while (end < rows.contacts && rows.row[end].sample == k) ++end;
    const bool all_held = end - row == static_cast<int>(placed.primitives());
    if (!placed.near(s, all_held ? -deepest : -lost)) continue;
    const double overlap = -placed.gap(s).distance;
    deepest = std::max(deepest, overlap);
    if (all_held) continue;
    // How deep it is in the primitives that it has rows for: one of them may imply the nearest's.
    double activation = -std::numeric_limits<double>::infinity();
    for (int i = row; i < end; ++i)
      activation =
          std::max(activation, -placed.gap(static_cast<std::size_t>(rows.row[i].primitive), s).distance);
    if (overlap > activation + same_gap) lost = std::max(lost, overlap);
  }
  return deepest;
}

}  // namespace

Vec6 inverse_stiffness(const VirtualCoupling& coupling, double period) noexcept {
  const double damped = 1 + coupling.damping_time / period;
  Vec6 K_inv;
  K_inv.head<3>().setConstant(coupling.stiffness > 0 ? 1 / (coupling.stiffness * damped) : 0);
  K_inv.tail<3>().setConstant(coupling.rotational_stiffness > 0 ? 1 / (coupling.rotational_stiffness * damped)
                                                                : 0);
  return K_inv;
}

ContactSolution solve_contact(const CondensedProblem& problem, const Instrument& instrument,
                              const Pose& X_device, double period, const ContactOptions& options,
                              ContactState& state, ContactScratch& scratch) noexcept {
  const Vec6 K_inv = inverse_stiffness(problem.coupling, period);
  // K_eff⁻¹ (B/T) e_prev: the part of the last offset that the coupling's damper still holds.
  const double lag = problem.coupling.damping_time / (period + problem.coupling.damping_time);
  Vec6 activation = lag * state.coupling_offset;
  Vec6 offset = state.coupling_offset;
  for (int c = 0; c < 6; ++c)
    if (K_inv[c] == 0) activation[c] = offset[c] = 0;
  const Pose X_free = displaced(X_device, -activation);
  const double margin = options.margin > 0 ? options.margin : problem.alarm_distance;

  ContactSolution out;
  if (problem.renewal == Renewal::frozen) {
    solve_frozen(problem, instrument, X_free, K_inv, margin, options, state, scratch, out);
  } else {
    solve_renewed(problem, instrument, X_free, displaced(X_device, -offset), K_inv, margin, options, state,
                  scratch, out);
  }
  out.contacts = scratch.rows.contacts;
  out.dropped = scratch.rows.dropped;
  // A pose that is not finite selects no rows and solves nothing, but would spoil the coupling's memory.
  if (out.status == SolveStatus::not_finite || !out.wrench.allFinite() || !X_device.p.allFinite() ||
      !X_device.q.coeffs().allFinite()) {
    state = ContactState{};
    std::fill(scratch.lambda.begin(), scratch.lambda.end(), 0.0);
    out.status = SolveStatus::not_finite;
    out.wrench.setZero();
    out.instrument = X_free;
    return out;
  }
  for (int i = 0; i < out.contacts; ++i) out.active += scratch.lambda[scratch.rows.rows_per_contact * i] > 0;
  out.penetration = deepest_overlap(problem, instrument, out.instrument, scratch, out.lost);
  if ((out.status == SolveStatus::solved && !out.laboured) || scratch.rows.rows_per_contact == 1)
    state.resumed = 0;
  else if (state.resumed > 0 && out.residual <= options.usable_residual)
    --state.resumed;
  else if (out.residual > doubtful * options.usable_residual)
    state.resumed = solves_resumed;
  if (!serves(options, out)) return out;
  state.coupling_offset = difference(X_device, out.instrument);
  for (int c = 0; c < 6; ++c)
    if (K_inv[c] == 0) state.coupling_offset[c] = 0;
  return out;
}

}  // namespace hapticd
