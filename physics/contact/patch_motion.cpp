// Contact memory by sample id, and how the patch moves under contact forces: x = x_free + C_pp f.
#include <algorithm>

#include "physics/contact/instrument_pairs.h"
#include "physics/contact/rows.h"

namespace hapticd {
namespace {

using NodeForces = std::array<double, 3 * max_patch_nodes>;

void add_force(const PatchSample& s, const Vec3& force, NodeForces& f) noexcept {
  if (s.node[0] < 0) return;
  for (int a = 0; a < 3; ++a)
    for (int c = 0; c < 3; ++c) f[3 * s.node[a] + c] += s.weight[a] * force[c];
}

void apply_compliance(const CondensedProblem& problem, const NodeForces& f, PatchPositions& x) noexcept {
  const int size = 3 * problem.nodes;
  NodeForces u{};
  for (int j = 0; j < size; ++j) {
    if (f[j] == 0) continue;
    const double* column = problem.C_pp.data() + static_cast<std::ptrdiff_t>(j) * size;
    for (int i = 0; i < size; ++i) u[i] += f[j] * column[i];
  }
  for (int a = 0; a < problem.nodes; ++a)
    x[a] = problem.x_free[a] + Vec3(u[3 * a], u[3 * a + 1], u[3 * a + 2]);
}

const PatchSample* find_sample(const CondensedProblem& problem, std::uint64_t id) noexcept {
  const auto begin = problem.sample.begin(), end = begin + problem.samples;
  const auto found =
      std::lower_bound(begin, end, id, [](const PatchSample& s, std::uint64_t key) { return s.id < key; });
  return found != end && found->id == id ? &*found : nullptr;
}

}  // namespace

const ContactMemory::Entry* ContactMemory::find(std::uint64_t id, int instrument) const noexcept {
  const auto end = entry.begin() + count;
  const auto found = std::lower_bound(entry.begin(), end, id, [&](const Entry& e, std::uint64_t key) {
    return e.id != key ? e.id < key : e.instrument < instrument;
  });
  return found != end && found->id == id && found->instrument == instrument ? &*found : nullptr;
}

const ContactMemory::Entry* ContactMemory::find(std::uint64_t id, int instrument,
                                                int primitive) const noexcept {
  const Entry* const end = entry.data() + count;
  for (const Entry* e = find(id, instrument); e && e != end && e->id == id && e->instrument == instrument;
       ++e)
    if (e->primitive == primitive) return e;
  return nullptr;
}

void displaced_patch(const CondensedProblem& problem, const ContactRows& rows, std::span<const double> lambda,
                     PatchPositions& x) noexcept {
  NodeForces f{};
  for (int i = 0; i < rows.contacts; ++i) {
    Vec3 force = Vec3::Zero();
    for (int c = 0; c < rows.rows_per_contact; ++c)
      force += lambda[rows.rows_per_contact * i + c] * rows.row[i].frame.col(c);
    if (rows.row[i].other < 0) add_force(problem.sample[rows.row[i].sample], force, f);
  }
  apply_compliance(problem, f, x);
}

Vec3 ContactMemory::force_on(std::uint64_t id) const noexcept {
  Vec3 force = Vec3::Zero();
  const auto begin = entry.begin(), end = begin + count;
  auto e = std::lower_bound(begin, end, id, [](const Entry& a, std::uint64_t key) { return a.id < key; });
  for (; e != end && e->id == id; ++e) force += e->lambda;
  return force;
}

bool forgets(const CondensedProblem& problem, const ContactMemory& memory) noexcept {
  return std::any_of(memory.entry.begin(), memory.entry.begin() + memory.count,
                     [&](const ContactMemory::Entry& e) {
                       return !e.lambda.isZero(0) && !is_pair(e.id) && find_sample(problem, e.id) == nullptr;
                     });
}

void displaced_patch(const CondensedProblem& problem, const ContactMemory& memory,
                     PatchPositions& x) noexcept {
  // Nor is anything known of who has met no force yet, while others may long hold the tissue down there.
  if (memory.count == 0 || forgets(problem, memory)) {
    std::copy_n(problem.x_now.begin(), problem.nodes, x.begin());
    return;
  }
  NodeForces f{};
  for (int m = 0; m < memory.count; ++m)
    if (const PatchSample* sample = find_sample(problem, memory.entry[m].id))
      add_force(*sample, memory.entry[m].lambda, f);
  apply_compliance(problem, f, x);
}

}  // namespace hapticd
