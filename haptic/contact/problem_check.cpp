#include "haptic/contact/problem_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "physics/contact/delassus_columns.h"

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

bool is_sound(const ContactMemory& m) noexcept {
  if (m.count < 0 || m.count > max_contacts) return false;
  return std::all_of(m.entry.begin(), m.entry.begin() + m.count, [](const ContactMemory::Entry& e) {
    return e.lambda.allFinite() && e.anchor.allFinite() && e.other_anchor.allFinite() &&
           std::isfinite(e.advance);
  });
}

bool is_sound(const InstrumentReference& i) noexcept {
  return i.X_ref.p.allFinite() && std::abs(i.X_ref.q.norm() - 1) <= tolerance && i.load.allFinite() &&
         i.way.allFinite() && i.offset.allFinite() && at_least_zero(i.coupling.stiffness) &&
         at_least_zero(i.coupling.rotational_stiffness) && at_least_zero(i.coupling.damping_time);
}

using delassus::Lanes;
using delassus::load;

// Of a compliance; the roots of its diagonal, and ε.
struct ComplianceCheck {
  const double* C;
  int size;
  std::array<double, 3 * max_patch_nodes> root;
  double slack = 0;

  const double* at(int i, int j) const noexcept { return C + static_cast<std::ptrdiff_t>(j) * size + i; }

  // Not `>`: no number is no compliance.
  bool entry(int i, int j) const noexcept {
    return std::abs(*at(i, j)) <= root[i] * root[j] + slack && std::abs(*at(i, j) - *at(j, i)) <= slack;
  }

  // Rows i to i + 3 of columns j to j + 3 and their mirror, which is columns away.
  bool tile(int i, int j) const noexcept {
    const Lanes a = load(at(j, i)), b = load(at(j, i + 1)), c = load(at(j, i + 2)), d = load(at(j, i + 3));
    const Lanes ab0 = __builtin_shufflevector(a, b, 0, 4, 2, 6),
                ab1 = __builtin_shufflevector(a, b, 1, 5, 3, 7);
    const Lanes cd0 = __builtin_shufflevector(c, d, 0, 4, 2, 6),
                cd1 = __builtin_shufflevector(c, d, 1, 5, 3, 7);
    const Lanes mirrored[4] = {
        __builtin_shufflevector(ab0, cd0, 0, 1, 4, 5), __builtin_shufflevector(ab1, cd1, 0, 1, 4, 5),
        __builtin_shufflevector(ab0, cd0, 2, 3, 6, 7), __builtin_shufflevector(ab1, cd1, 2, 3, 6, 7)};
    const Lanes roots = load(root.data() + i);
    auto sound = roots == roots;
    for (int k = 0; k < 4; ++k) {
      const Lanes own = load(at(i, j + k)), off = own - mirrored[k], most = roots * root[j + k] + slack;
      sound &= (own <= most) & (own >= -most) & (off <= slack) & (off >= -slack);
    }
    return sound[0] & sound[1] & sound[2] & sound[3];
  }
};

bool compliance_is_sound(const CondensedProblem& p) noexcept {
  ComplianceCheck check{p.C().data(), 3 * p.nodes, {}, 0};
  double largest = 0;
  for (int i = 0; i < check.size; ++i) {
    const double own = *check.at(i, i);
    if (!at_least_zero(own)) return false;
    check.root[i] = std::sqrt(own);
    largest = std::max(largest, own);
  }
  check.slack = tolerance * largest;
  // Tiles by blocks, whose mirrors' lines of memory then serve several.
  constexpr int side = 4, block = 32;
  bool sound = true;
  const auto look = [&](int i, int j) {
    if (j + side <= check.size) {
      sound &= check.tile(i, j);
      return;
    }
    for (int column = j; column < check.size; ++column)
      for (int row = i; row < std::min(i + side, column); ++row) sound &= check.entry(row, column);
  };
  for (int left = 0; left < check.size; left += block)
    for (int top = 0; top <= left; top += block)
      for (int j = left; j < std::min(left + block, check.size); j += side)
        for (int i = top; i < std::min(top + block, j + 1); i += side) look(i, j);
  return sound;
}

}  // namespace

bool is_sound(const CondensedProblem& p) noexcept {
  if (p.nodes < 0 || p.nodes > max_patch_nodes || p.samples < 0 || p.samples > max_patch_samples)
    return false;
  for (int k = 0; k < p.samples; ++k)
    if (!is_sound(p.sample[k], p.nodes)) return false;
  for (const InstrumentReference& i : p.instrument.value)
    if (!is_sound(i)) return false;
  return positions_are_sound(p) && is_sound(p.known) && edges_are_sound(p) &&
         at_least_zero(p.instrument_friction) && compliance_is_sound(p);
}

}  // namespace hapticd
