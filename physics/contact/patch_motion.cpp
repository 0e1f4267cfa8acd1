// How the patch moves under contact forces: x = x_free + C_pp f.
#include <algorithm>

#include "physics/contact/instrument_pairs.h"
#include "physics/contact/rows.h"

namespace hapticd {
namespace {

using NodeForces = std::array<double, 3 * max_patch_nodes>;

void add_force(const NodeWeights& at, const Vec3& force, NodeForces& f) noexcept {
  for (std::size_t a = 0; a < at.node.size(); ++a)
    for (int c = 0; c < 3; ++c) f[3 * at.node[a] + c] += at.weight[a] * force[c];
}

void apply_compliance(const CondensedProblem& problem, const NodeForces& f, PatchPositions& x) noexcept {
  const int size = 3 * problem.nodes;
  NodeForces u;
  std::fill_n(u.begin(), size, 0.0);
  for (int j = 0; j < size; j += 3) {
    if (f[j] == 0 && f[j + 1] == 0 && f[j + 2] == 0) continue;
    const double* C = problem.C().data() + static_cast<std::ptrdiff_t>(j) * size;
    const double scale = problem.column_scale[j / 3];
    const double g[3] = {scale * f[j], scale * f[j + 1], scale * f[j + 2]};
    for (int i = 0; i < size; ++i) u[i] = u[i] + g[0] * C[i] + g[1] * C[size + i] + g[2] * C[2 * size + i];
  }
  for (int a = 0; a < problem.nodes; ++a)
    x[a] = problem.x_free[a] + Vec3(u[3 * a], u[3 * a + 1], u[3 * a + 2]);
}

template <typename Sample>
const Sample* find_by_id(const Sample* begin, int count, std::uint64_t id) noexcept {
  const Sample* const end = begin + count;
  const Sample* found =
      std::lower_bound(begin, end, id, [](const Sample& s, std::uint64_t key) { return s.id < key; });
  return found != end && found->id == id ? found : nullptr;
}

const PatchSample* find_sample(const CondensedProblem& problem, std::uint64_t id) noexcept {
  return find_by_id(problem.sample.data(), problem.samples, id);
}

const EdgeSample* find_edge(const CondensedProblem& problem, std::uint64_t id) noexcept {
  return find_by_id(problem.edge.data(), problem.edges, id);
}

// None: no such sample, or an obstacle's.
NodeWeights find_nodes(const CondensedProblem& problem, std::uint64_t id) noexcept {
  if (!is_edge(id)) {
    const PatchSample* sample = find_sample(problem, id);
    return sample ? node_weights(*sample) : NodeWeights{};
  }
  const EdgeSample* edge = find_edge(problem, id);
  return edge ? NodeWeights{edge->node, edge->weight} : NodeWeights{};
}

bool is_there(const CondensedProblem& problem, std::uint64_t id) noexcept {
  return is_pair(id) ||
         (is_edge(id) ? find_edge(problem, id) != nullptr : find_sample(problem, id) != nullptr);
}

}  // namespace

NodeWeights node_weights(const PatchSample& s) noexcept {
  return s.node[0] < 0 ? NodeWeights{} : NodeWeights{s.node, s.weight};
}

NodeWeights node_weights(const CondensedProblem& problem, const ContactRow& row) noexcept {
  if (row.sample >= 0) return node_weights(problem.sample[row.sample]);
  if (row.edge < 0) return {};
  return {problem.edge[row.edge].node, problem.edge[row.edge].weight};
}

void displaced_patch(const CondensedProblem& problem, const ContactRows& rows, std::span<const double> lambda,
                     PatchPositions& x) noexcept {
  NodeForces f;
  std::fill_n(f.begin(), 3 * problem.nodes, 0.0);
  for (int i = 0; i < rows.contacts; ++i) {
    const double* const l = lambda.data() + rows.rows_per_contact * i;
    if (std::all_of(l, l + rows.rows_per_contact, [](double of) { return of == 0; })) continue;
    Vec3 force = Vec3::Zero();
    for (int c = 0; c < rows.rows_per_contact; ++c)
      force += lambda[rows.rows_per_contact * i + c] * rows.row[i].frame.col(c);
    add_force(node_weights(problem, rows.row[i]), force, f);
  }
  apply_compliance(problem, f, x);
}

bool forgets(const CondensedProblem& problem, const ContactMemory& memory) noexcept {
  return std::any_of(
      memory.entry.begin(), memory.entry.begin() + memory.count,
      [&](const ContactMemory::Entry& e) { return !e.lambda.isZero(0) && !is_there(problem, e.id); });
}

void displaced_patch(const CondensedProblem& problem, const ContactMemory& memory,
                     PatchPositions& x) noexcept {
  // Nor is anything known of who has met no force yet, while others may long hold the tissue down there.
  if (!memory.knows_tissue() || forgets(problem, memory)) {
    std::copy_n(problem.x_now.begin(), problem.nodes, x.begin());
    return;
  }
  NodeForces f;
  std::fill_n(f.begin(), 3 * problem.nodes, 0.0);
  for (int m = 0; m < memory.count; ++m)
    add_force(find_nodes(problem, memory.entry[m].id), memory.entry[m].lambda, f);
  apply_compliance(problem, f, x);
}

}  // namespace hapticd
