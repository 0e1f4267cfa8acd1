// Unfinished solves: Newton's unfinished steps may be anything, and friction would remember them. So a solve
// with friction that ends at a cap or its deadline goes back to where it began, and takes turns of what nears
// the solution from wherever it starts: normal forces for the friction there is (lcp.h), then sweeps. It
// would end there again in the next tick: until turns alone solve one, or 200 were usable, solves take their
// turns first; with time left, the whole solver. What they reach is remembered, usable or not.
//
// What is left unsolved ends with normal forces all the same, once more, in time kept for it: a crumb of some
// micrograms gives way by 0.1 mm to a force that no residual shows.
//
// Two sweeps hardly ever solve anything. If every turn raised ε for that, it would stay raised for the next
// solves, and a tick would take three times as long. So turns raise it only where the last solve ended
// unusable; if they never did, a wedge would jam for 20 to 50 ticks.
#include "physics/contact/solver/rows_solve.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

// Of a resumed solve, of normal forces and sweeps; more would leave Newton no time.
constexpr int first_turns = 3;
constexpr int most_turns = 8;      // where the whole solver has not ended
constexpr int share_of_turns = 4;  // one part of so many of the time left, where the whole solver goes first
constexpr int share_of_last = 12;  // … for the normal forces of what ends unusable
constexpr int sweeps_in_a_turn = 2;  // more, and the solver would try from zero

// Makes W's columns where they are not all there.
ColumnsOnDemand columns_of(ContactScratch& scratch) noexcept {
  if (!scratch.on_demand) return {};
  if (scratch.rows.rows_per_contact == 1)
    return {[](void* to, int contact) noexcept { static_cast<DelassusColumns<1>*>(to)->make(contact); },
            &scratch.columns.normal};
  return {[](void* to, int contact) noexcept { static_cast<DelassusColumns<3>*>(to)->make(contact); },
          &scratch.columns.whole};
}

// Normal forces, for the friction there is, of contacts that press or penetrate; friction stays in its cone.
// Edges keep their forces: theirs are bounded, and sweeps move them.
void solve_normals(const ContactOptions& options, ContactScratch& scratch) noexcept {
  const ContactRows& rows = scratch.rows;
  const ColumnsOnDemand columns = columns_of(scratch);
  const auto W = rows.W();
  std::array<double, max_contacts> delta_n;
  for (int i = 0; i < rows.contacts; ++i) delta_n[i] = rows.q()[3 * i];
  for (int j = 0; j < rows.contacts; ++j) {
    const Vec3 l = local_lambda(scratch, j);
    if (l.isZero(0)) continue;
    columns.ask(j);
    for (int i = 0; i < rows.contacts; ++i)
      for (int c = 0; c < 3; ++c) delta_n[i] += W(3 * i, 3 * j + c) * l[c];
  }
  std::array<int, max_contacts> contact;
  int n = 0;
  for (int i = 0; i < rows.contacts; ++i)
    if (rows.row[i].edge < 0 && (scratch.lambda[3 * i] > 0 || delta_n[i] < 0)) contact[n++] = i;
  if (n == 0) return;
  Eigen::Map<MatX> W_nn(scratch.normal_W.data(), n, n);
  Eigen::Map<VecX> q_n(scratch.normal_q.data(), n), z(scratch.normal_lambda.data(), n);
  for (int j = 0; j < n; ++j) {
    columns.ask(contact[j]);
    q_n[j] = delta_n[contact[j]];
    z[j] = scratch.lambda[3 * contact[j]];
    scratch.active[j] = z[j] > 0;
    for (int i = 0; i < n; ++i) W_nn(i, j) = W(3 * contact[i], 3 * contact[j]);
  }
  q_n -= W_nn.lazyProduct(z);
  LcpOptions lcp = options.lcp;
  lcp.deadline = options.deadline;
  const LcpResult r =
      solve_lcp(W_nn, q_n, z, {scratch.active.data(), static_cast<std::size_t>(n)}, scratch.lcp, 0, lcp);
  if (r.status != SolveStatus::solved) return;
  for (int i = 0; i < n; ++i) {
    Eigen::Map<Vec3> l(scratch.lambda.data() + 3 * contact[i]);
    l[0] = z[i];
    const double t = l.tail<2>().norm(), most = scratch.mu[contact[i]] * l[0];
    if (t > most) l.tail<2>() *= most / t;
  }
}

// Friction rows of `scratch`, by the Coulomb solver.
void solve_friction(CoulombOptions options, ContactScratch& scratch, ContactSolution& out) noexcept {
  const ContactRows& rows = scratch.rows;
  options.columns = columns_of(scratch);
  Eigen::Map<VecX> lambda(scratch.lambda.data(), rows.rows());
  const std::span<const double> mu{scratch.mu.data(), static_cast<std::size_t>(rows.contacts)};
  const std::span<const double> limit{scratch.limit.data(), rows.edges > 0 ? mu.size() : 0};
  const CoulombResult r =
      solve_coulomb(rows.W(), rows.q(), mu, lambda, scratch.coulomb, scratch.matrix_version, options, limit);
  out.status = r.status;
  out.residual = r.residual;
  out.near = out.near || (options.max_newton == 0 && r.sweeps > 0);
}

bool ended(const ContactSolution& out) noexcept {
  return out.status == SolveStatus::solved || out.status == SolveStatus::not_finite;
}

// Normal forces and sweeps; true if that solves it.
bool take_turns(const ContactOptions& options, int turns, bool may_raise, ContactScratch& scratch,
                ContactSolution& out) noexcept {
  CoulombOptions sweeps = options.coulomb;
  sweeps.deadline = options.deadline;
  sweeps.max_newton = 0;
  sweeps.max_sweeps = std::min(sweeps_in_a_turn, sweeps.max_sweeps);
  if (!may_raise) sweeps.raised_diagonal = 0;
  for (int turn = 0; turn < turns; ++turn) {
    if (!options.deadline.passed()) solve_normals(options, scratch);
    solve_friction(sweeps, scratch, out);
    if (ended(out) || options.deadline.passed()) break;
  }
  return ended(out);
}

// The whole solver, with all but this part of the time; if that does not end, more turns from where it began.
void solve_whole(const ContactOptions& options, std::int64_t reserve_ns, bool may_raise,
                 ContactScratch& scratch, ContactSolution& out) noexcept {
  const ContactSolution before = out;
  const int rows = scratch.rows.rows();
  std::copy_n(scratch.lambda.begin(), rows, scratch.resumed_lambda.begin());
  CoulombOptions whole = options.coulomb;
  whole.deadline = options.deadline;
  whole.deadline.reserve_ns += reserve_ns;
  solve_friction(whole, scratch, out);
  if (ended(out) || (!before.near && !(out.residual > doubtful * options.usable_residual))) return;
  std::copy_n(scratch.resumed_lambda.begin(), rows, scratch.lambda.begin());
  if (before.near) out = before;
  if (!before.near || !options.deadline.passed()) take_turns(options, most_turns, may_raise, scratch, out);
}

}  // namespace

Vec3 local_lambda(const ContactScratch& scratch, int i) noexcept {
  Vec3 l = Vec3::Zero();
  const int m = scratch.rows.rows_per_contact;
  for (int c = 0; c < m; ++c) l[c] = scratch.lambda[m * i + c];
  return l;
}

void solve_rows(const ContactOptions& given, int resumed, ContactScratch& scratch,
                ContactSolution& out) noexcept {
  const Within solve(given.times, ContactPart::solve);
  const ContactRows& rows = scratch.rows;
  ContactOptions options = given;
  if (given.deadline.bounded() && rows.rows_per_contact > 1)
    options.deadline.reserve_ns += std::max<std::int64_t>(0, given.deadline.left() / share_of_last);
  const bool may_raise = resumed == solves_resumed;
  if (rows.rows_per_contact == 1) {
    LcpOptions lcp = options.lcp;
    lcp.deadline = options.deadline;
    lcp.columns = columns_of(scratch);
    const auto contacts = static_cast<std::size_t>(rows.contacts);
    Eigen::Map<VecX> lambda(scratch.lambda.data(), rows.rows());
    const LcpResult r = solve_lcp(rows.W(), rows.q(), lambda, {scratch.active.data(), contacts}, scratch.lcp,
                                  scratch.matrix_version, lcp);
    out.status = r.status;
    out.residual = r.residual;
  } else if (resumed == 0) {
    const std::int64_t kept =
        options.deadline.bounded() ? std::max<std::int64_t>(0, options.deadline.left() / share_of_turns) : 0;
    solve_whole(options, kept, may_raise, scratch, out);
  } else if (!take_turns(options, first_turns, may_raise, scratch, out) && !options.deadline.passed()) {
    solve_whole(options, 0, may_raise, scratch, out);
    out.laboured = ended(out);
  }
  if (rows.rows_per_contact > 1 && !ended(out) && std::isfinite(given.usable_residual))
    solve_normals(given, scratch);
}

}  // namespace hapticd
