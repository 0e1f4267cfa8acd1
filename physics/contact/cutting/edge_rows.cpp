// Two rows for a viscous edge: the dry one, 0 ≤ λ₁ ≤ J w with δ ≤ 0 at its limit, and 0 ≤ λ₂ ⟂ δ + ε λ₂ ≥ 0
// with ε = T/(c w). Open, both forces are zero. Where the first is below its limit δ = 0, so λ₂ = 0. At the
// limit δ = −ε λ₂ = −a: λ₁ + λ₂ = J w + c w a/T. ε > 0 makes the two one by one definite.
#include "physics/contact/cutting/edge_rows.h"

#include <algorithm>

namespace hapticd {

Vec3 front_position(const CondensedProblem& problem, const PatchPositions& x, int edge) noexcept {
  const EdgeSample& e = problem.edge[edge];
  Vec3 s = Vec3::Zero();
  for (int a = 0; a < 4; ++a) s += e.weight[a] * x[e.node[a]];
  return s;
}

double total_advance(const EdgeSample& edge, const ContactMemory::Entry* known) noexcept {
  return known ? std::max(known->advance, edge.advance) : edge.advance;
}

int count_edges(const CondensedProblem& problem, const InstrumentPoses& X_lin) noexcept {
  int count = 0;
  for (int k = 0; k < problem.edges; ++k)
    if (X_lin.present[problem.edge[k].instrument]) count += problem.edge[k].viscosity > 0 ? 2 : 1;
  return count;
}

void add_edges(const CondensedProblem& problem, const InstrumentPoses& X_free, const InstrumentPoses& X_lin,
               const PatchPositions& x_lin, const ContactMemory& memory, double period,
               ContactRows& rows) noexcept {
  const int before = rows.contacts;
  for (int k = 0; k < problem.edges; ++k) {
    const EdgeSample& e = problem.edge[k];
    if (!X_lin.present[e.instrument]) continue;
    const Pose& X = X_lin[e.instrument];
    ContactRow& row = rows.row[rows.contacts++];
    row.sample = row.other = -1;
    row.edge = k;
    row.incision = false;
    row.instrument = e.instrument;
    row.primitive = 0;
    row.id = e.id;
    row.friction = 0;
    row.limit = e.limit;
    row.compliance = 0;
    const Vec3 normal = X.q * e.direction, front = front_position(problem, x_lin, k),
               free = front_position(problem, problem.x_free, k);
    row.frame = contact_frame(normal);
    row.arm = front - X.p;
    row.anchor = row.other_anchor = Vec3::Zero();  // nothing slips on it
    row.advance = total_advance(e, memory.find(e.id, e.instrument));
    row.gap = normal.dot(front - X.to_world(e.place)) + row.advance - e.advance;
    const Vec6 shift = difference(X_free[e.instrument], X);
    const Vec3 blade = shift.head<3>() + shift.tail<3>().cross(row.arm);
    row.delta_free = {row.gap + normal.dot(free - front - blade), 0, 0};
    if (!(e.viscosity > 0)) continue;
    ContactRow& viscous = rows.row[rows.contacts++];
    viscous = row;
    viscous.primitive = 1;
    viscous.limit = no_limit;
    viscous.compliance = period / e.viscosity;
  }
  rows.edges = rows.contacts - before;
}

double advance_after(const ContactRow& row, double W_nn, double lambda_n, double delta_n) noexcept {
  if (row.limit == no_limit) return row.advance;  // the viscous one: the dry one tells
  return row.advance + std::max(0.0, -delta_n - W_nn * (row.limit - lambda_n));
}

double advance_to_realise(const CondensedProblem& problem, const ContactMemory& memory, int edge) noexcept {
  const EdgeSample& e = problem.edge[edge];
  return total_advance(e, memory.find(e.id, e.instrument)) - e.advance;
}

}  // namespace hapticd
