// Missed contacts: what no row holds may spring through the instrument, where normals point out on its wrong
// side. So a solve that leaves a sample deeper than `margin`, or one that was nearer than `margin` at all
// inside, is repeated at its own linearisation with that sample's rows.
//
// Sticking is judged by slip, ‖δ_t‖ ≤ 1e-6 · tr W_ii/3 · ‖λ_i‖, or by λ being inside its cone; a slip below
// that adds up until it shows. An anchor that stays keeps holding still from creeping.
//
// Linearisations: only about a solution. About what solves nothing the rows would be of any place, and a
// solve of those rows no solution here, whatever its residual. So the first takes the time that it needs, a
// later one that ends doubtful is left out, and the status says so: kept, it would have the next solves
// resumed, which take twice as long. A resumed solve that is usable, but not solved, has no later one: that
// would end the same way.
#include "physics/contact/contact_solve.h"

#include <algorithm>
#include <cmath>

#include "physics/contact/cutting/edge_rows.h"
#include "physics/contact/incision/incision_rows.h"
#include "physics/contact/missed_contact.h"
#include "physics/contact/placed_instruments.h"
#include "physics/contact/solver/rows_solve.h"

namespace hapticd {
namespace {

constexpr double most_pulled_off = 0.1;  // alarm distances
constexpr double still = 30e-9;          // a gap that is off by that is off by nothing [m]
constexpr int most_returns = 8;          // to a linearisation whose solve let tissue through
constexpr int most_more = 3;             // linearisations while a sample ends too deep

std::span<const double> solved(const ContactScratch& scratch) noexcept {
  return {scratch.lambda.data(), static_cast<std::size_t>(scratch.rows.rows())};
}

void warm_start(const ContactMemory& memory, ContactScratch& scratch) noexcept {
  const int m = scratch.rows.rows_per_contact;
  int from = 0;
  for (int i = 0; i < scratch.rows.contacts; ++i) {
    const ContactRow& row = scratch.rows.row[i];
    const ContactMemory::Entry* known = memory.find(row.id, row.instrument, row.primitive, from);
    const Vec3 l = known ? Vec3(row.frame.transpose() * known->lambda) : Vec3::Zero();
    for (int c = 0; c < m; ++c) scratch.lambda[m * i + c] = l[c];
    scratch.active[i] = l[0] > 0;
    scratch.mu[i] = row.friction;
    scratch.limit[i] = row.limit;
  }
}

// λ in world axes, and the anchors that the rows were built with.
void remember_linearisation(const ContactScratch& scratch, ContactMemory& memory) noexcept {
  memory.count = scratch.rows.contacts;
  for (int i = 0; i < scratch.rows.contacts; ++i) {
    const ContactRow& row = scratch.rows.row[i];
    memory.entry[i] = {row.id,           row.frame * local_lambda(scratch, i),
                       row.anchor,       false,
                       row.primitive,    row.instrument,
                       row.other_anchor, row.advance};
  }
}

// δ of some rows, from this one on. W is symmetric: its columns are its rows, and contiguous.
template <int count>
Eigen::Matrix<double, count, 1> delta(const ContactScratch& scratch, int first) noexcept {
  const ContactRows& rows = scratch.rows;
  const Eigen::Map<const VecX> lambda(scratch.lambda.data(), rows.rows());
  return rows.W().middleCols<count>(first).transpose() * lambda + rows.q().segment<count>(first);
}

bool sticks(const ContactScratch& scratch, int i) noexcept {
  const ContactRows& rows = scratch.rows;
  const Vec3 l = local_lambda(scratch, i);
  const double mu = rows.row[i].friction;
  if (rows.rows_per_contact == 1 || mu <= 0 || l[0] <= 0) return false;
  if (l.tail<2>().norm() <= inside_the_cone * mu * l[0]) return true;
  return delta<2>(scratch, 3 * i + 1).norm() <=
         sticking_slip * rows.W().block<3, 3>(3 * i, 3 * i).trace() / 3 * l.norm();
}

// Memory of the solve for the next one. `place` gives a sample's place in the instrument's frame. X_lin: of
// the rows; where two instruments slide on one another the next slip counts from where they were nearest.
template <typename Place>
void remember_solve(const CondensedProblem& problem, const InstrumentPoses& X_lin,
                    const ContactScratch& scratch, ContactMemory& memory, const Place& place) noexcept {
  remember_linearisation(scratch, memory);
  for (int i = 0; i < scratch.rows.contacts; ++i) {
    ContactMemory::Entry& e = memory.entry[i];
    e.sticking = sticks(scratch, i);
    const ContactRow& row = scratch.rows.row[i];
    if (e.sticking) continue;
    if (row.edge >= 0) {
      const int n = scratch.rows.rows_per_contact * i;
      e.advance = advance_after(row, scratch.rows.W()(n, n), scratch.lambda[n], delta<1>(scratch, n)[0]);
    } else if (row.incision) {
      const Pose& X = X_lin[row.instrument];
      e.anchor = place(row, X.p + row.arm);
      e.other_anchor = ring_at_rest(row, X, local_lambda(scratch, i));
    } else if (row.other < 0) {
      e.anchor = place(row, sample_position(problem, scratch.x, row.sample));
    } else {
      e.anchor = X_lin[row.instrument].q.conjugate() * row.arm;
      e.other_anchor = X_lin[row.other].q.conjugate() * row.other_arm;
    }
  }
}

// Overlap by instrument of what no row holds, where it is known of the last solve.
struct Lost {
  EachInstrument<double> of;
  bool known = false;
};

// Of any sample, and of those that no row holds.
void measure_overlap(const CondensedProblem& problem, Instruments instruments, ContactScratch& scratch,
                     ContactSolution& out, Lost& lost) noexcept {
  if (lost.known) return;
  out.penetration = out.lost = 0;
  lost = {{}, true};
  const PlacedInstruments placed(instruments, out.instrument);
  const auto in_reach = scratch.in_reach.at(problem, placed, out.instrument, scratch.x, 0,
                                            reach_slack * problem.alarm_distance);
  for (int i = 0; i < instruments.count(); ++i) {
    if (placed.at(i))
      out.penetration = std::max(out.penetration, deepest_overlap(problem, *placed.at(i), i, in_reach,
                                                                  scratch.rows, scratch.x, lost.of[i]));
    out.lost = std::max(out.lost, lost.of[i]);
  }
}

// Whether the rows hold good where their solve ends: forces have turned with their normals by less than
// options.turned, weighted by their size; no gap is off by more than `still`; no sample without a row is
// inside. Of a blade's edge that is not asked: it goes on.
bool holds_good(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X_lin,
                const ContactOptions& options, ContactScratch& scratch, ContactSolution& out,
                Lost& lost) noexcept {
  const ContactRows& rows = scratch.rows;
  if (rows.edges > 0) return false;
  const EachInstrument<Vec6> moved = difference(out.instrument, X_lin);
  const auto way = [&](int i, const Vec3& arm) {
    return (moved[i].head<3>() + moved[i].tail<3>().cross(arm)).norm();
  };
  const PlacedInstruments placed(instruments, out.instrument);
  double sum = 0, turned = 0;
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[i];
    const double force = local_lambda(scratch, i).norm();
    sum += force;
    if (row.incision) {
      if (force > 0) turned += force * way(row.instrument, row.arm) / (row.advance - row.gap);
    } else if (row.other >= 0) {
      if (way(row.instrument, row.arm) + way(row.other, row.other_arm) > still) return false;
    } else {
      const Gap gap =
          placed.at(row.instrument)
              ->gap(static_cast<std::size_t>(row.primitive), sample_position(problem, scratch.x, row.sample));
      if (gap.distance < -still || (force > 0 && gap.distance > still)) return false;
      turned += force * (gap.normal - row.frame.col(0)).norm();
    }
  }
  if (turned > options.turned * sum) return false;
  measure_overlap(problem, instruments, scratch, out, lost);
  return out.lost <= still;
}

// Whether it is to be remembered.
bool serves(const ContactOptions& options, const ContactSolution& out) noexcept {
  return out.near || out.status == SolveStatus::solved || out.residual <= options.usable_residual;
}

// The poses that the problem was gathered at, of those present.
InstrumentPoses reference_poses(const CondensedProblem& problem, const InstrumentPoses& present) noexcept {
  InstrumentPoses X = present;
  for (int i = 0; i < max_instruments; ++i)
    if (X.present[i]) X[i] = problem.instrument[i].X_ref;
  return X;
}

void solve_frozen(const CondensedProblem& problem, Instruments instruments, const CouplingStart& start,
                  double margin, double period, const ContactOptions& options, ContactState& state,
                  ContactScratch& scratch, ContactSolution& out) noexcept {
  const InstrumentPoses X_ref = reference_poses(problem, start.X_free);
  if (problem.step == 0 || state.frozen_step != problem.step || scratch.matrix_version == 0 ||
      state.frozen_present.value != start.X_free.present.value) {
    build_rows(problem, instruments, X_ref, X_ref, problem.x_now, start.K_inv, state.memory, margin,
               scratch.rows, nullptr, options.times, period, nullptr, &scratch.in_reach);
    scratch.on_demand = false;
    ++scratch.matrix_version;
    state.frozen_step = problem.step;
    state.frozen_present = start.X_free.present;
  }
  shift_rows(problem, X_ref, start.X_free, state.memory, scratch.rows);
  warm_start(state.memory, scratch);
  solve_rows(options, state.resumed, scratch, out);
  displaced_patch(problem, scratch.rows, solved(scratch), scratch.x);
  out.wrench = wrench_on_instruments(scratch.rows, solved(scratch));
  out.instrument = placed_by(start, out.wrench);
  // Anchors in the frozen rows' own linear kinematics, or a pose held still would seem to slip.
  const EachInstrument<Vec6> moved = difference(out.instrument, X_ref);
  if (serves(options, out))
    remember_solve(problem, X_ref, scratch, state.memory, [&](const ContactRow& row, const Vec3& s) {
      const Vec6& d = moved[row.instrument];
      return X_ref[row.instrument].to_local(s - d.head<3>() - d.tail<3>().cross(row.arm));
    });
}

// Where the first linearisation is. Forces of the last solve against a pull of suction are a small difference
// of large ones, and a loose piece is carried off by what rounding leaves: where that says much, it goes with
// who holds it.
void start_patch(const CondensedProblem& problem, const InstrumentPoses& X, const ContactMemory& memory,
                 PatchPositions& x) noexcept {
  displaced_patch(problem, memory, x);
  for (int i = 0; i < max_instruments; ++i) {
    if (problem.instrument[i].load.isZero(0)) continue;
    const Vec6& way = problem.instrument[i].way;
    const Vec3 origin = X[i].p - way.head<3>();
    const auto carried = [&](int n) {
      const Vec3& from = problem.x_now[n];
      return Vec3(from + way.head<3>() + way.tail<3>().cross(from - origin));
    };
    const double most = most_pulled_off * problem.alarm_distance;
    double off = 0;
    for (int n = 0; n < problem.nodes; ++n) off = std::max(off, (x[n] - carried(n)).squaredNorm());
    if (off < most * most) return;
    for (int n = 0; n < problem.nodes; ++n) x[n] = carried(n);
    return;
  }
}

void solve_renewed(const CondensedProblem& problem, Instruments instruments, const CouplingStart& start,
                   double margin, double period, const ContactOptions& options, ContactState& state,
                   ContactScratch& scratch, ContactSolution& out, Lost& lost) noexcept {
  scratch.working = state.memory;
  scratch.kept.outside = state.memory.outside;
  start_patch(problem, start.X_start, state.memory, scratch.x);
  out.instrument = start.X_start;
  const int linearisations = std::max(1, options.linearisations);
  const double activation =
      options.activation_distance > 0 ? std::min(options.activation_distance, margin) : margin;
  PatchPositions x_lin;
  InstrumentPoses X_lin;
  const auto build = [&](const Reached* reached) {
    EitherColumns* const columns = options.whole_W ? nullptr : &scratch.columns;
    build_rows(problem, instruments, start.X_free, X_lin, x_lin, start.K_inv, scratch.working, activation,
               scratch.rows, reached, options.times, period, columns, &scratch.in_reach);
    scratch.on_demand = columns && scratch.rows.edges == 0;
    ++scratch.matrix_version;
  };
  // False if the solver met no number.
  const auto solve = [&] {
    warm_start(scratch.working, scratch);
    lost.known = false;
    solve_rows(options, state.resumed, scratch, out);
    if (out.status == SolveStatus::not_finite) return false;
    displaced_patch(problem, scratch.rows, solved(scratch), scratch.x);
    out.wrench = wrench_on_instruments(scratch.rows, solved(scratch));
    out.instrument = placed_by(start, out.wrench);
    remember_linearisation(scratch, scratch.working);
    return true;
  };
  const auto remember = [&](ContactMemory& memory) {
    remember_solve(problem, X_lin, scratch, memory, [&](const ContactRow& row, const Vec3& s) {
      return out.instrument[row.instrument].to_local(s);
    });
  };
  const auto usable = [&] {
    return out.status == SolveStatus::solved || out.residual <= options.usable_residual;
  };
  const auto trusted = [&] {
    return out.status == SolveStatus::solved || out.residual <= doubtful * options.usable_residual;
  };
  const auto is_too_deep = [&] {
    measure_overlap(problem, instruments, scratch, out, lost);
    return out.penetration > options.too_deep;
  };
  for (int k = 0; k < linearisations + most_more; ++k) {
    if (k >= linearisations && !(options.too_deep > 0 && usable() && is_too_deep())) break;
    if (k > 0 && options.deadline.passed()) {
      out.status = SolveStatus::deadline;
      break;
    }
    if (k > 0 && state.resumed > 0 && out.status != SolveStatus::solved) break;
    if (k > 0 && options.turned > 0 && out.status == SolveStatus::solved &&
        holds_good(problem, instruments, X_lin, options, scratch, out, lost))
      break;
    if (k > 0) remember(scratch.kept);
    std::copy_n(scratch.x.begin(), problem.nodes, x_lin.begin());
    X_lin = out.instrument;
    const ContactSolution before = out;
    build(nullptr);
    if (!solve()) return;
    for (int again = 0; again < most_returns && usable() && !options.deadline.passed(); ++again) {
      const Reached end{scratch.x, out.instrument, options.most_new};
      if (!violates_inactive_contact(problem, instruments, X_lin, x_lin, activation, margin,
                                     state.memory.outside, scratch.rows, end, scratch.in_reach))
        break;
      build(&end);
      if (!solve()) return;
    }
    if (k == 0 && !usable()) break;
    if (k > 0 && !trusted()) {
      // It is left out.
      const SolveStatus status = out.status;
      out = before;
      out.status = status;
      scratch.x = x_lin;
      state.memory = scratch.kept;
      warm_start(state.memory, scratch);
      return;
    }
  }
  if (serves(options, out)) remember(state.memory);
}

}  // namespace

ContactSolution solve_contact(const CondensedProblem& problem, Instruments instruments,
                              const InstrumentPoses& X_device, double period, const ContactOptions& options,
                              ContactState& state, ContactScratch& scratch) noexcept {
  const CouplingStart start = start_coupling(problem, X_device, period, state.coupling_offset);
  const double margin = options.margin > 0 ? options.margin : problem.alarm_distance;

  scratch.in_reach.keep(options.numbered ? problem.step : 0);
  ContactSolution out;
  Lost lost;
  if (problem.renewal == Renewal::frozen)
    solve_frozen(problem, instruments, start, margin, period / options.parts, options, state, scratch, out);
  else
    solve_renewed(problem, instruments, start, margin, period / options.parts, options, state, scratch, out,
                  lost);
  out.contacts = scratch.rows.contacts;
  out.dropped = scratch.rows.dropped;
  // A pose that is not finite selects no rows and solves nothing, but would spoil the coupling's memory.
  bool finite = out.status != SolveStatus::not_finite;
  for (int i = 0; i < max_instruments; ++i)
    finite = finite && out.wrench[i].allFinite() &&
             (!X_device.present[i] || (X_device[i].p.allFinite() && X_device[i].q.coeffs().allFinite()));
  if (!finite) {
    state = ContactState{};
    std::fill(scratch.lambda.begin(), scratch.lambda.end(), 0.0);
    out.status = SolveStatus::not_finite;
    out.wrench = {};
    out.instrument = start.X_free;
    return out;
  }
  for (int i = 0; i < max_instruments; ++i)
    if (X_device.present[i]) out.wrench[i] += problem.instrument[i].load;
  for (int i = 0; i < out.contacts; ++i) out.active += scratch.lambda[scratch.rows.rows_per_contact * i] > 0;
  measure_overlap(problem, instruments, scratch, out, lost);
  for (int i = 0; i < instruments.count(); ++i) {
    bool& outside = state.memory.outside[i];
    if (!X_device.present[i] || problem.renewal == Renewal::frozen)
      outside = false;
    else if (serves(options, out))
      outside = is_outside(problem, i, outside, scratch.rows, solved(scratch), scratch.x, lost.of[i]);
  }
  if ((out.status == SolveStatus::solved && !out.laboured) || scratch.rows.rows_per_contact == 1)
    state.resumed = 0;
  else if (out.residual > options.usable_residual)
    state.resumed = solves_resumed;
  else if (state.resumed > 0)
    --state.resumed;
  else if (out.residual > doubtful * options.usable_residual)
    state.resumed = solves_resumed - 1;
  if (!serves(options, out)) return out;
  state.coupling_offset = coupling_offset(X_device, out.instrument, start.K_inv);
  return out;
}

}  // namespace hapticd
