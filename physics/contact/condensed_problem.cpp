#include "physics/contact/condensed_problem.h"

#include <algorithm>

namespace hapticd {

void fold_scale(CondensedProblem& problem) noexcept {
  for (int n = 0; n < problem.nodes; ++n) problem.C().middleCols<3>(3 * n) *= problem.column_scale[n];
  problem.column_scale = all_nodes(1);
}

namespace {

void copy_all_but_compliance(const CondensedProblem& from, CondensedProblem& to) noexcept {
  to.step = from.step;
  to.published_ns = from.published_ns;
  to.instrument = from.instrument;
  to.instrument_friction = from.instrument_friction;
  to.renewal = from.renewal;
  to.topology_changed = from.topology_changed;
  to.thinned = from.thinned;
  to.known_sound = false;
  to.alarm_distance = from.alarm_distance;
  to.nodes = from.nodes;
  to.samples = from.samples;
  to.edges = from.edges;
  to.dropped_samples = from.dropped_samples;
  std::copy_n(from.x_free.begin(), from.nodes, to.x_free.begin());
  std::copy_n(from.x_now.begin(), from.nodes, to.x_now.begin());
  std::copy_n(from.pull.begin(), from.nodes, to.pull.begin());
  std::copy_n(from.sample.begin(), from.samples, to.sample.begin());
  std::copy_n(from.edge.begin(), from.edges, to.edge.begin());
  to.known = from.known;
  std::copy_n(from.column_scale.begin(), from.nodes, to.column_scale.begin());
}

}  // namespace

void CondensedProblem::keep_own_compliance() noexcept {
  std::copy_n(lender->C_pp.begin(), 9 * nodes * nodes, C_pp.begin());
  lender = nullptr;
}

void copy_in_use(const CondensedProblem& from, CondensedProblem& to) noexcept {
  copy_all_but_compliance(from, to);
  std::copy_n(from.C().data(), 9 * from.nodes * from.nodes, to.C_pp.begin());
  to.lender = nullptr;
}

void lend(const CondensedProblem& from, CondensedProblem& to) noexcept {
  copy_all_but_compliance(from, to);
  to.lender = &from;
}

}  // namespace hapticd
