#include "haptic/contact/problem_check.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace hapticd {
namespace {

constexpr double tolerance = 1e-3;
constexpr double largest_weight = 1e3;

bool positions_are_sound(const CondensedProblem& p) noexcept {
  for (int n = 0; n < p.nodes; ++n)
    if (!p.x_free[n].allFinite() || !p.x_now[n].allFinite() || !p.pull[n].allFinite()) return false;
  return std::isfinite(p.alarm_distance);
}

bool is_sound(const PatchSample& s, int nodes) noexcept {
  const bool obstacle = s.node[0] < 0;
  if (obstacle && !s.free.allFinite()) return false;
  for (int a = 0; a < 3 && !obstacle; ++a)
    if (s.node[a] < 0 || s.node[a] >= nodes || !(std::abs(s.weight[a]) <= largest_weight)) return false;
  return s.outward.norm() <= 1 + tolerance && s.friction >= 0 && std::isfinite(s.friction);
}

bool at_least_zero(double x) noexcept { return x >= 0 && std::isfinite(x); }

bool is_sound(const EdgeSample& e, int nodes) noexcept {
  for (int a = 0; a < 4; ++a)
    if (e.node[a] < 0 || e.node[a] >= nodes || !(std::abs(e.weight[a]) <= largest_weight)) return false;
  return is_edge(e.id) && e.instrument >= 0 && e.instrument < max_instruments && e.place.allFinite() &&
         std::abs(e.direction.norm() - 1) <= tolerance && at_least_zero(e.limit) &&
         at_least_zero(e.advance) && at_least_zero(e.viscosity);
}

// Memory is found by id, so two of one id would share it.
bool edges_are_sound(const CondensedProblem& p) noexcept {
  if (p.edges < 0 || p.edges > max_edge_samples) return false;
  for (int k = 0; k < p.edges; ++k)
    if (!is_sound(p.edge[k], p.nodes) || (k > 0 && p.edge[k - 1].id >= p.edge[k].id)) return false;
  return true;
}

bool is_sound(const InstrumentReference& i) noexcept {
  return i.X_ref.p.allFinite() && std::abs(i.X_ref.q.norm() - 1) <= tolerance && i.load.allFinite() &&
         i.way.allFinite() && at_least_zero(i.coupling.stiffness) &&
         at_least_zero(i.coupling.rotational_stiffness) && at_least_zero(i.coupling.damping_time);
}

bool compliance_is_sound(const CondensedProblem& p) noexcept {
  const auto C = p.C();
  const int size = 3 * p.nodes;
  std::array<double, 3 * max_patch_nodes> root;
  double largest = 0;
  for (int i = 0; i < size; ++i) {
    if (!at_least_zero(C(i, i))) return false;
    root[i] = std::sqrt(C(i, i));
    largest = std::max(largest, C(i, i));
  }
  const double slack = tolerance * largest;
  for (int j = 0; j < size; ++j)
    for (int i = 0; i < j; ++i) {
      // Not `>`: no number is no compliance.
      if (!(std::abs(C(i, j)) <= root[i] * root[j] + slack && std::abs(C(i, j) - C(j, i)) <= slack))
        return false;
    }
  return true;
}

}  // namespace

bool is_sound(const CondensedProblem& p) noexcept {
  if (p.nodes < 0 || p.nodes > max_patch_nodes || p.samples < 0 || p.samples > max_patch_samples)
    return false;
  for (int k = 0; k < p.samples; ++k)
    if (!is_sound(p.sample[k], p.nodes)) return false;
  for (const InstrumentReference& i : p.instrument.value)
    if (!is_sound(i)) return false;
  return positions_are_sound(p) && edges_are_sound(p) && at_least_zero(p.instrument_friction) &&
         compliance_is_sound(p);
}

}  // namespace hapticd
