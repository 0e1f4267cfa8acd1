#include "physics/cutting/subdivision.h"

#include <algorithm>

#include "physics/tissue/mesh_quality.h"
#include "physics/tissue/surface.h"
#include "physics/tissue/tetrahedron.h"
#include "physics/tissue/volume_barrier.h"

namespace hapticd {

namespace {

int corner_of(const Tet& tet, int node) noexcept {
  return static_cast<int>(std::find(tet.begin(), tet.end(), node) - tet.begin());
}

bool contains(const std::vector<int>& sorted, int i) noexcept {
  return std::binary_search(sorted.begin(), sorted.end(), i);
}

double quality_of(const Corners& x) noexcept {
  return dihedral_quality(x.col(0), x.col(1), x.col(2), x.col(3));
}

bool keeps_quality(const TissueModel& model, int tet, const EdgePoint& at, const Vec3& m,
                   double bound) noexcept {
  const Corners whole = corners_of(model.mesh.tets[tet], model.mesh.nodes);
  Corners half_a = whole;
  Corners half_b = whole;
  half_a.col(corner_of(model.mesh.tets[tet], at.b)) = m;
  half_b.col(corner_of(model.mesh.tets[tet], at.a)) = m;
  const double least = std::min(quality_of(half_a), quality_of(half_b));
  return least >= bound || least >= quality_of(whole);
}

void set_shape(TissueModel& model, int tet) noexcept {
  const Corners x = corners_of(model.mesh.tets[tet], model.mesh.nodes);
  const RestShape shape = rest_shape(x.col(0), x.col(1), x.col(2), x.col(3));
  model.gradients[tet] = shape.gradients;
  model.volume[tet] = shape.volume;
}

int add_node(TissueModel& model, TissueState& state, CutWorkspace& work, const EdgePoint& at,
             TopologyChange& change) noexcept {
  const int m = take_node(model);
  const auto between = [&](const std::vector<Vec3>& v) -> Vec3 {
    return (1 - at.s) * v[at.a] + at.s * v[at.b];
  };
  model.mesh.nodes[m] = between(model.mesh.nodes);
  state.x[m] = between(state.x);
  state.v[m] = between(state.v);
  model.fixed[m] = model.fixed[at.a] && model.fixed[at.b];
  for (MeshGroup& group : model.mesh.groups) {
    const auto grouped = [&](int t) { return contains(group.tets, t); };
    if ((contains(group.nodes, at.a) && contains(group.nodes, at.b)) ||
        std::any_of(work.star.begin(), work.star.end(), grouped))
      group.nodes.push_back(m);
  }
  change.nodes.push_back(m);
  change.node_of.push_back(-1);
  return m;
}

// The half at b of `tet`, with all that is its own; faces follow in `join_halves`.
void add_half(TissueModel& model, TissueState& state, CutWorkspace& work, int tet, const EdgePoint& at, int m,
              TopologyChange& change) noexcept {
  const int half = model.tets_in_use++;
  const Tet whole = model.mesh.tets[tet];
  const int i = corner_of(whole, at.a);
  const int j = corner_of(whole, at.b);
  model.mesh.tets[half] = whole;
  model.mesh.tets[half][i] = m;
  model.mesh.tets[tet][j] = m;
  model.parent[half] = tet;
  model.elastic[half] = model.elastic[tet];
  state.alive[half] = 1;
  state.left[half] = state.left[tet];
  state.rotation[half] = state.rotation[tet];
  set_shape(model, tet);
  set_shape(model, half);
  for (MeshGroup& group : model.mesh.groups)
    if (contains(group.tets, tet)) group.tets.push_back(half);

  work.stars.unlink(at.b, tet, j);
  work.stars.link(m, tet, j);
  for (int corner = 0; corner < 4; ++corner) work.stars.link(model.mesh.tets[half][corner], half, corner);
  work.label[tet] = half;
  change.add_tet(tet);
  change.add_tet(half);
}

// The faces of a tetrahedron (the half at a) and its other half (label). The face opposite to a is now the
// half at b's; the one opposite to b stays; between them is m c d; the two with the edge are split as the
// neighbour's are. A removed neighbour is not split: those faces end at nothing.
void join_halves(TissueModel& model, CutWorkspace& work, int tet, const EdgePoint& at, int m) noexcept {
  const int half = work.label[tet];
  const int i = corner_of(model.mesh.tets[tet], at.a);
  const int j = corner_of(model.mesh.tets[tet], m);
  for (int f = 0; f < 4; ++f) {
    const int id = 4 * tet + f;
    const int id_half = 4 * half + f;
    const int other = model.across[id];
    if (f == j) continue;
    work.held_open[id_half] = work.held_open[id];
    model.across[id_half] = other;
    if (f == i) {
      if (other >= 0) model.across[other] = id_half;
    } else if (other >= 0) {
      const int other_half = work.label[other / 4];
      if (other_half >= 0)
        model.across[id_half] = 4 * other_half + other % 4;
      else
        model.across[id] = model.across[id_half] = model.across[other] = opened_face;
    }
  }
  model.across[4 * tet + i] = 4 * half + j;
  model.across[4 * half + j] = 4 * tet + i;
  work.held_open[4 * tet + i] = work.held_open[4 * half + j] = 0;
}

// Both halves of a collapsed tetrahedron are.
void split_collapsed(const TissueModel& model, TissueState& state, CutWorkspace& work) noexcept {
  if (state.collapsed.empty()) return;
  std::erase_if(state.collapsed, [&](const Collapsed& c) { return work.label[c.tet] >= 0; });
  for (const int t : work.star)
    for (const int half : {t, work.label[t]})
      barrier(model, half,
              deformation_gradient(corners_of(model.mesh.tets[half], state.x), model.gradients[half]), state);
}

}  // namespace

CutStatus split_edge(TissueModel& model, TissueState& state, CutWorkspace& work, const EdgePoint& at,
                     double bound, TopologyChange& change) noexcept {
  work.stars.live(state, at.a, work.star);
  std::erase_if(work.star, [&](int t) { return corner_of(model.mesh.tets[t], at.b) == 4; });
  if (work.star.empty() || !(at.s > 0 && at.s < 1)) return CutStatus::nothing;
  if (model.nodes_in_use == model.node_count() ||
      model.tets_in_use + static_cast<int>(work.star.size()) > model.tet_count())
    return CutStatus::no_room;
  const Vec3 place = (1 - at.s) * model.mesh.nodes[at.a] + at.s * model.mesh.nodes[at.b];
  for (const int t : work.star)
    if (!keeps_quality(model, t, at, place, bound)) return CutStatus::poor;

  // The other two nodes of each have one tetrahedron more, and the mass they had.
  for (const int t : work.star)
    for (const int n : model.mesh.tets[t]) ++state.live_tets_of_node[n];
  const int m = add_node(model, state, work, at, change);
  for (const int t : work.star) add_half(model, state, work, t, at, m, change);
  for (const int t : work.star) join_halves(model, work, t, at, m);
  split_collapsed(model, state, work);
  for (const int t : work.star) work.label[t] = -1;

  for (const int n : {at.a, at.b, m}) sum_star(model, state, work, n);
  return CutStatus::done;
}

}  // namespace hapticd
