#include "physics/compliance/system_matrix.h"

#include <algorithm>

#include "physics/tissue/tetrahedron.h"
#include "physics/tissue/volume_barrier.h"

namespace hapticd {

namespace {

constexpr int corner_pairs[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

// A static body has neither inertia nor damping.
double mass_factor(const Material& m, bool dynamic, double h) noexcept {
  return dynamic ? 1 / (h * h) + m.rayleigh_mass / h : 0;
}
double stiffness_factor(const Material& m, bool dynamic, double h) noexcept {
  return dynamic ? 1 + m.rayleigh_stiffness / h : 1;
}

}  // namespace

SystemMatrix::SystemMatrix(const TissueModel& model, const NodeGraph& graph, double h)
    : h_(h),
      material_(model.material),
      dynamic_(model.dynamic),
      fixed_(model.fixed),
      springs_(model.springs),
      condensed_(model.condensed) {
  const int nodes = graph.node_count();
  std::vector<int> first_edge(nodes + 1, 0);
  edges_.reserve(graph.neighbour.size() / 2);
  for (int i = 0; i < nodes; ++i) {
    first_edge[i] = static_cast<int>(edges_.size());
    for (const int j : graph.of(i))
      if (j > i) edges_.push_back({i, j});
  }
  first_edge[nodes] = static_cast<int>(edges_.size());
  const auto edge_between = [&](int i, int j) {
    if (fixed_[i] || fixed_[j]) return -1;
    const auto last = edges_.begin() + first_edge[i + 1];
    const auto found = std::lower_bound(edges_.begin() + first_edge[i], last, j,
                                        [](const Edge& e, int node) { return e.j < node; });
    return static_cast<int>(found - edges_.begin());
  };

  elements_.resize(model.tet_count());
  for (int t = 0; t < model.tets_in_use; ++t) {
    Element& element = elements_[t];
    element = element_of(model, t);
    for (int p = 0; p < 6; ++p)
      element.edge[p] = edge_between(element.node[corner_pairs[p][0]], element.node[corner_pairs[p][1]]);
  }
  if (condensed_)
    for (std::size_t j = 0; j < condensed_->node.size(); ++j)
      for (std::size_t i = 0; i < j; ++i)
        condensed_edge_.push_back(edge_between(condensed_->node[i], condensed_->node[j]));
  diagonal_.resize(nodes);
  coupling_.resize(edges_.size());
  in_system_.resize(nodes);
}

SystemMatrix::Element element_of(const TissueModel& model, int t) noexcept {
  const Tet& tet = model.mesh.tets[t];
  SystemMatrix::Element element;
  std::array<int, 4> corner = {0, 1, 2, 3};
  std::sort(corner.begin(), corner.end(), [&](int a, int b) { return tet[a] < tet[b]; });
  for (int a = 0; a < 4; ++a) {
    element.node[a] = tet[corner[a]];
    element.gradients.col(a) = model.gradients[t].col(corner[a]);
  }
  element.volume = model.volume[t];
  element.law = model.elastic[t];
  return element;
}

int known_ancestor(const TissueModel& model, std::span<const SystemMatrix::Element> elements,
                   int t) noexcept {
  while (elements[t].node == no_tet) {
    if (model.parent[t] == t) return -1;
    t = model.parent[t];
  }
  return t;
}

double SystemMatrix::stiffness() const noexcept { return stiffness_factor(material_, dynamic_, h_); }
double SystemMatrix::lumped_mass(const Element& element) const noexcept {
  return mass_factor(material_, dynamic_, h_) * 0.25 * element.law.density * element.volume;
}

void SystemMatrix::assemble(const TissueState& state) noexcept {
  std::fill(diagonal_.begin(), diagonal_.end(), Mat3::Zero());
  std::fill(coupling_.begin(), coupling_.end(), Mat3::Zero());
  for (std::size_t t = 0; t < elements_.size(); ++t) {
    if (!state.alive[t]) continue;
    const Element& element = elements_[t];
    const Gradients b = state.rotation[t] * element.gradients;
    const double mu = this->mu(element), lambda = this->lambda(element);
    const double volume = state.left[t] * element.volume;
    for (int a = 0; a < 4; ++a)
      diagonal_[element.node[a]] += stiffness_block(b.col(a), b.col(a), volume, mu, lambda);
    for (int p = 0; p < 6; ++p) {
      if (element.edge[p] < 0) continue;
      coupling_[element.edge[p]] +=
          stiffness_block(b.col(corner_pairs[p][0]), b.col(corner_pairs[p][1]), volume, mu, lambda);
    }
  }

  for (const Collapsed& c : state.collapsed)
    if (state.alive[c.tet]) add_collapsed(c);
  if (condensed_) add_condensed();

  double trace = 0;
  int nodes = 0;
  for (int n = 0; n < node_count(); ++n) {
    in_system_[n] = !fixed_[n] && state.live_tets_of_node[n] > 0;
    if (!in_system_[n]) continue;
    diagonal_[n].diagonal().array() += mass_factor(material_, dynamic_, h_) * state.mass[n];
    if (!springs_.empty()) diagonal_[n].diagonal().array() += stiffness() * springs_[n].stiffness;
    trace += diagonal_[n].trace();
    ++nodes;
  }
  identity_scale_ = nodes > 0 && trace > 0 ? trace / (3 * nodes) : 1.0;
  for (int n = 0; n < node_count(); ++n)
    if (!in_system_[n]) diagonal_[n] = identity_scale_ * Mat3::Identity();
}

void SystemMatrix::add_collapsed(const Collapsed& c) noexcept {
  const Element& element = elements_[c.tet];
  if (!same_corners(element.node, c.node)) return;  // it was cut since, and its rotation is not found yet
  const std::array<int, 4> corner = corners_in_order(element.node, c.node);
  for (int a = 0; a < 4; ++a)
    diagonal_[element.node[a]] += stiffness() * barrier_block(c, corner[a], corner[a]);
  for (int p = 0; p < 6; ++p)
    if (element.edge[p] >= 0)
      coupling_[element.edge[p]] +=
          stiffness() * barrier_block(c, corner[corner_pairs[p][0]], corner[corner_pairs[p][1]]);
}

void SystemMatrix::add_condensed() noexcept {
  auto edge = condensed_edge_.begin();
  for (int j = 0; j < static_cast<int>(condensed_->node.size()); ++j) {
    for (int i = 0; i < j; ++i) coupling_[*edge++] += stiffness() * condensed_->block(i, j);
    diagonal_[condensed_->node[j]] += stiffness() * condensed_->block(j, j);
  }
}

std::vector<std::uint8_t> SystemMatrix::live_edges(const TissueState& state) const {
  std::vector<std::uint8_t> live(edges_.size(), 0);
  for (std::size_t t = 0; t < elements_.size(); ++t) {
    if (!state.alive[t]) continue;
    for (const int e : elements_[t].edge)
      if (e >= 0) live[e] = 1;
  }
  for (const int e : condensed_edge_) live[e] = 1;
  return live;
}

NodeGraph SystemMatrix::graph_of(const std::vector<std::uint8_t>& live_edges) const {
  NodeGraph graph;
  graph.start.assign(node_count() + 1, 0);
  for (std::size_t e = 0; e < edges_.size(); ++e) {
    if (!live_edges[e]) continue;
    ++graph.start[edges_[e].i + 1];
    ++graph.start[edges_[e].j + 1];
  }
  for (int n = 0; n < node_count(); ++n) graph.start[n + 1] += graph.start[n];
  graph.neighbour.resize(graph.start.back());
  std::vector<int> next(graph.start.begin(), graph.start.end() - 1);
  // Of each node first the lower neighbours, then the higher ones: ascending, as the edges are sorted.
  for (std::size_t e = 0; e < edges_.size(); ++e)
    if (live_edges[e]) graph.neighbour[next[edges_[e].j]++] = edges_[e].i;
  for (std::size_t e = 0; e < edges_.size(); ++e)
    if (live_edges[e]) graph.neighbour[next[edges_[e].i]++] = edges_[e].j;
  return graph;
}

VecX SystemMatrix::multiply(const VecX& x) const {
  VecX y(x.size());
  for (int n = 0; n < node_count(); ++n) y.segment<3>(3 * n) = diagonal_[n] * x.segment<3>(3 * n);
  for (std::size_t e = 0; e < edges_.size(); ++e) {
    const auto [i, j] = edges_[e];
    y.segment<3>(3 * i) += coupling_[e] * x.segment<3>(3 * j);
    y.segment<3>(3 * j) += coupling_[e].transpose() * x.segment<3>(3 * i);
  }
  return y;
}

VecX multiply_system_matrix(const TissueModel& model, const TissueState& state, double h, const VecX& x) {
  const double stiffness = stiffness_factor(model.material, model.dynamic, h);
  const double mass = mass_factor(model.material, model.dynamic, h);
  VecX y = VecX::Zero(x.size());
  subtract_stiffness(model, state, x, -stiffness, y);
  for (const Collapsed& c : state.collapsed)
    for (int i = 0; state.alive[c.tet] && i < 4; ++i)
      for (int j = 0; j < 4; ++j)
        y.segment<3>(3 * c.node[i]) += stiffness * (barrier_block(c, i, j) * x.segment<3>(3 * c.node[j]));
  for (int n = 0; n < model.node_count(); ++n)
    if (model.fixed[n] || state.live_tets_of_node[n] == 0)
      y.segment<3>(3 * n).setZero();
    else
      y.segment<3>(3 * n) += mass * state.mass[n] * x.segment<3>(3 * n);
  return y;
}

Eigen::SparseMatrix<double> assemble_system_matrix(const TissueModel& model, const TissueState& state,
                                                   double h) {
  const int dofs = 3 * model.node_count();
  const auto in_system = [&](int n) { return !model.fixed[n] && state.live_tets_of_node[n] > 0; };
  std::vector<Eigen::Triplet<double>> entries;
  double trace = 0;
  int nodes = 0;
  const auto add = [&](int i, int j, const Mat3& block) {
    if (!in_system(i) || !in_system(j)) return;
    if (i == j) trace += block.trace();
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) entries.emplace_back(3 * i + r, 3 * j + c, block(r, c));
  };
  for (int t = 0; t < model.tet_count(); ++t) {
    if (!state.alive[t]) continue;
    const Tet& tet = model.mesh.tets[t];
    const Gradients b = state.rotation[t] * model.gradients[t];
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
        add(tet[i], tet[j],
            stiffness_factor(model.material, model.dynamic, h) *
                stiffness_block(b.col(i), b.col(j), volume_left(model, state, t), model.elastic[t].mu,
                                model.elastic[t].lambda));
  }
  for (const Collapsed& c : state.collapsed)
    for (int i = 0; state.alive[c.tet] && i < 4; ++i)
      for (int j = 0; j < 4; ++j)
        add(c.node[i], c.node[j],
            stiffness_factor(model.material, model.dynamic, h) * barrier_block(c, i, j));
  for (int j = 0; model.condensed && j < static_cast<int>(model.condensed->node.size()); ++j)
    for (int i = 0; i < static_cast<int>(model.condensed->node.size()); ++i)
      add(model.condensed->node[i], model.condensed->node[j],
          stiffness_factor(model.material, model.dynamic, h) * model.condensed->block(i, j));
  for (int n = 0; n < model.node_count(); ++n) {
    if (!in_system(n)) continue;
    add(n, n, mass_factor(model.material, model.dynamic, h) * state.mass[n] * Mat3::Identity());
    if (!model.springs.empty())
      add(n, n,
          stiffness_factor(model.material, model.dynamic, h) * model.springs[n].stiffness * Mat3::Identity());
    ++nodes;
  }
  const double identity_scale = nodes > 0 && trace > 0 ? trace / (3 * nodes) : 1.0;
  for (int n = 0; n < model.node_count(); ++n)
    if (!in_system(n))
      for (int r = 0; r < 3; ++r) entries.emplace_back(3 * n + r, 3 * n + r, identity_scale);
  Eigen::SparseMatrix<double> A(dofs, dofs);
  A.setFromTriplets(entries.begin(), entries.end());
  return A;
}

}  // namespace hapticd
