#include "haptic/contact/viscous_patch.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double same_period = 0.05;      // of it: arrivals jitter by less, which is not the hand's
constexpr int body_shift = 56;            // of a sample's id (patch.cpp)
constexpr double quantum_energy = 10e-6;  // that one reading may be worth [J]
constexpr double quantum_force = 8;       // … beyond which the lag does not help [N]
constexpr double quantum_lag = 0.15e-3;   // [s]

// β of each node, from the body in the ids of the samples on it, or of the front in it. False if all are
// zero.
bool find_relaxation(const CondensedProblem& p, const ViscousOptions& options,
                     std::array<double, max_patch_nodes>& relaxation) noexcept {
  std::fill_n(relaxation.begin(), p.nodes, 0.0);
  bool any = false;
  for (int k = 0; k < p.samples; ++k) {
    const PatchSample& s = p.sample[k];
    const std::uint64_t body = s.id >> body_shift;
    if (s.node[0] < 0 || body >= options.relaxation.size()) continue;
    for (const int n : s.node) relaxation[n] = options.relaxation[body];
    any = any || options.relaxation[body] > 0;
  }
  for (int k = 0; k < p.edges; ++k) {
    const auto body = static_cast<std::size_t>(p.edge[k].body);
    if (body < options.relaxation.size())
      for (const int n : p.edge[k].node) relaxation[n] = options.relaxation[body];
  }
  return any;
}

// Positions by node of `to` of what `from` knew by its own; both have their samples sorted by id, and a
// face's corners are named in the same order in each.
void carry_over(const CondensedProblem& from, const PatchPositions& known, const CondensedProblem& to,
                PatchPositions& x) noexcept {
  int i = 0;
  for (int k = 0; k < to.samples; ++k) {
    const PatchSample& s = to.sample[k];
    while (i < from.samples && from.sample[i].id < s.id) ++i;
    if (i == from.samples) return;
    if (from.sample[i].id != s.id || s.node[0] < 0 || from.sample[i].node[0] < 0) continue;
    for (int c = 0; c < 3; ++c) x[s.node[c]] = known[from.sample[i].node[c]];
  }
}

// Of the samples that both know; of all others none.
void carry_over(const CondensedProblem& from, const CondensedProblem& to,
                EachInstrument<Grip>& grip) noexcept {
  for (int i = 0; i < max_instruments; ++i) {
    Grip held{};
    int k = 0;
    for (int n = 0; n < to.samples; ++n) {
      while (k < from.samples && from.sample[k].id < to.sample[n].id) ++k;
      if (k == from.samples) break;
      if (from.sample[k].id == to.sample[n].id) held[n] = grip[i][k];
    }
    grip[i] = held;
  }
}

// `patch.problem` for a tick of `period`, from where the patch was before.
void set_period(double period, ViscousPatch& patch) noexcept {
  CondensedProblem& p = patch.problem;
  double T = period + patch.lag;
  if (std::abs(T - patch.period) <= same_period * patch.period) T = patch.period;
  patch.period = T;
  patch.share = 1 - patch.lag / T;
  for (int n = 0; n < p.nodes; ++n) {
    const double by_tick = patch.relaxation[n] / T;
    p.column_scale[n] = (1 + patch.relaxation[n] / patch.published) / (1 + by_tick);
    p.x_free[n] = (patch.equilibrium[n] + by_tick * patch.before[n]) / (1 + by_tick);
  }
}

}  // namespace

double lag_for(double quantum, double stiffness, double relaxation, double period) noexcept {
  const double force = relaxation / period * stiffness * quantum;
  return force * quantum > quantum_energy && force < quantum_force ? quantum_lag : 0;
}

const CondensedProblem& at_tick(const CondensedProblem& published, const ViscousOptions& options,
                                double period, ViscousPatch& patch) noexcept {
  if ((options.step <= 0 && !options.always) || published.renewal == Renewal::frozen) return published;
  patch.lag = options.lag;
  if (patch.step == 0 || patch.step != published.step) {
    std::array<double, max_patch_nodes> relaxation{};
    const bool viscous = options.step > 0 && find_relaxation(published, options, relaxation);
    if (!viscous && !options.always) {
      patch.step = 0;
      return published;
    }
    PatchPositions before;
    std::copy_n(published.x_now.begin(), published.nodes, before.begin());
    if (patch.step > 0) carry_over(patch.problem, patch.before, published, before);
    if (options.always && patch.step > 0) carry_over(patch.problem, published, patch.grip);
    if (options.always && patch.step == 0) patch.grip = {};
    lend(published, patch.problem);
    std::copy_n(before.begin(), published.nodes, patch.problem.x_now.begin());
    patch.before = before;
    patch.relaxation = relaxation;
    patch.step = published.step;
    patch.period = patch.published = options.step > 0 ? options.step : period;
    for (int n = 0; n < published.nodes; ++n) {
      const double by_step = relaxation[n] / patch.published;
      patch.equilibrium[n] = (1 + by_step) * published.x_free[n] - by_step * published.x_now[n];
    }
  }
  patch.problem.lender = &published;
  set_period(period, patch);
  return patch.problem;
}

const CondensedProblem* at_part_of_tick(double period, ViscousPatch& patch) noexcept {
  const CondensedProblem* lender = patch.problem.lender;
  if (patch.step == 0 || !lender || lender->step != patch.step) return nullptr;
  set_period(period, patch);
  return &patch.problem;
}

void remember(const PatchPositions& x, ViscousPatch& patch) noexcept {
  if (patch.share == 1) {
    std::copy_n(x.begin(), patch.problem.nodes, patch.before.begin());
    return;
  }
  for (int n = 0; n < patch.problem.nodes; ++n) patch.before[n] += patch.share * (x[n] - patch.before[n]);
}

}  // namespace hapticd
