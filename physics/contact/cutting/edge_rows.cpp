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
  return static_cast<int>(std::count_if(problem.edge.begin(), problem.edge.begin() + problem.edges,
                                        [&](const EdgeSample& e) { return X_lin.present[e.instrument]; }));
}

void add_edges(const CondensedProblem& problem, const InstrumentPoses& X_free, const InstrumentPoses& X_lin,
               const PatchPositions& x_lin, const ContactMemory& memory, ContactRows& rows) noexcept {
  const int before = rows.contacts;
  for (int k = 0; k < problem.edges; ++k) {
    const EdgeSample& e = problem.edge[k];
    if (!X_lin.present[e.instrument]) continue;
    const Pose& X = X_lin[e.instrument];
    ContactRow& row = rows.row[rows.contacts++];
    row.sample = row.other = -1;
    row.edge = k;
    row.instrument = e.instrument;
    row.primitive = 0;
    row.id = e.id;
    row.friction = 0;
    row.limit = e.limit;
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
  }
  rows.edges = rows.contacts - before;
}

double advance_after(const ContactRow& row, double W_nn, double lambda_n, double delta_n) noexcept {
  return row.advance + std::max(0.0, -delta_n - W_nn * (row.limit - lambda_n));
}

double advance_to_realise(const CondensedProblem& problem, const ContactMemory& memory, int edge) noexcept {
  const EdgeSample& e = problem.edge[edge];
  return total_advance(e, memory.find(e.id, e.instrument)) - e.advance;
}

}  // namespace hapticd
