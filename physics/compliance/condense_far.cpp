#include "physics/compliance/condense_far.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "physics/compliance/factor/multifrontal_factor.h"
#include "physics/compliance/submodel.h"
#include "physics/tissue/fragments.h"

namespace hapticd {
namespace {

constexpr int least_held = 3;  // nodes that hold a part still

// Per tetrahedron.
std::vector<std::uint8_t> far_tets(const TissueModel& model, const TissueState& state,
                                   std::span<const std::uint8_t> near) {
  TissueState far;
  far.alive.assign(state.alive.size(), 0);
  for (int t = 0; t < model.tets_in_use; ++t) far.alive[t] = state.alive[t] && !near[t];
  const std::vector<int> part = label_fragments(model, far);
  std::vector<std::vector<int>> held;
  for (int t = 0; t < model.tets_in_use; ++t) {
    if (part[t] < 0) continue;
    held.resize(std::max(held.size(), static_cast<std::size_t>(part[t]) + 1));
    for (const int n : model.mesh.tets[t])
      if (model.holds(n)) held[part[t]].push_back(n);
  }
  for (std::vector<int>& of : held) {
    std::sort(of.begin(), of.end());
    of.erase(std::unique(of.begin(), of.end()), of.end());
  }
  for (int t = 0; t < model.tets_in_use; ++t)
    if (part[t] >= 0 && held[part[t]].size() < least_held) far.alive[t] = 0;
  return far.alive;
}

std::vector<int> nodes_where(std::span<const std::uint8_t> holds) {
  std::vector<int> nodes;
  for (std::size_t n = 0; n < holds.size(); ++n)
    if (holds[n]) nodes.push_back(static_cast<int>(n));
  return nodes;
}

// The far tissue, and what is condensed already, alone.
class Far {
 public:
  Far(const TissueModel& model, const TissueState& state, std::vector<int> nodes,
      std::span<const int> boundary, std::span<const std::uint8_t> far)
      : part_(linear(model), std::move(nodes), nodes_where(far), model.condensed.get()),
        boundary_(part_.nodes_of(boundary)),
        first_(part_.model.node_count() - static_cast<int>(boundary_.size())) {
    for (std::size_t k = 0; k < part_.tet.size(); ++k) part_.state.left[k] = state.left[part_.tet[k]];
    refresh_mass(part_.model, part_.state);
    const NodeGraph graph = node_graph(part_.model);
    SystemMatrix matrix(part_.model, graph, 1);
    factor_.set_order(matrix, zone_last_order(graph, fill_reducing_order(graph), boundary_), {},
                      static_cast<int>(boundary_.size()));
    matrix.assemble(part_.state);
    factor_.condense(matrix, static_cast<int>(boundary_.size()), S_);
  }

  MatX stiffness() const {
    std::vector<int> at;
    for (const int n : boundary_)
      for (int r = 0; r < 3; ++r) at.push_back(3 * (factor_.place(n) - first_) + r);
    return S_(at, at);
  }

  // Rows' sums of Ψᵀ M Ψ, the mean of the three directions.
  std::vector<double> mass() {
    std::vector<double> mass(boundary_.size(), 0.0);
    for (int c = 0; c < 3; ++c) {
      Eigen::Map<VecX> x = factor_.vector();
      x.setZero();
      for (const int n : boundary_) x[3 * factor_.place(n) + c] = 1;
      factor_.extend();
      for (int n = 0; n < part_.model.node_count(); ++n)
        x.segment<3>(3 * factor_.place(n)) *= part_.state.mass[n];
      factor_.reduce();
      for (std::size_t i = 0; i < mass.size(); ++i) mass[i] += x[3 * factor_.place(boundary_[i]) + c] / 3;
    }
    for (double& m : mass) m = std::max(m, 0.0);
    return mass;
  }

  // Ψᵀ (f_ext + f_int) at rest.
  VecX load() {
    const TissueModel& m = part_.model;
    VecX f(3 * m.node_count()), inner(f.size());
    external_forces(m, part_.state, f);
    internal_forces(m, part_.state, inner);
    f += inner;
    Eigen::Map<VecX> x = factor_.vector();
    for (int n = 0; n < m.node_count(); ++n) {
      const bool is_free = !m.fixed[n] && part_.state.live_tets_of_node[n] > 0;
      x.segment<3>(3 * factor_.place(n)) = is_free ? Vec3(f.segment<3>(3 * n)) : Vec3(Vec3::Zero());
    }
    factor_.reduce();
    VecX of_b(3 * static_cast<Eigen::Index>(boundary_.size()));
    for (std::size_t i = 0; i < boundary_.size(); ++i)
      of_b.segment<3>(3 * static_cast<Eigen::Index>(i)) = x.segment<3>(3 * factor_.place(boundary_[i]));
    return of_b;
  }

 private:
  static TissueModel linear(const TissueModel& model) {
    TissueModel of = model;
    of.dynamic = of.corotational = false;
    return of;
  }

  Submodel part_;
  std::vector<int> boundary_;  // of the part
  int first_;                  // place of it
  MultifrontalFactor factor_;
  MatX S_;  // by the factor's places
};

}  // namespace

std::vector<std::uint8_t> tets_within(const TissueModel& model, const NearRegion& near) {
  std::vector<std::uint8_t> within(model.mesh.tets.size(), 0);
  for (int t = 0; t < model.tets_in_use; ++t) {
    Vec3 centroid = Vec3::Zero();
    for (const int n : model.mesh.tets[t]) centroid += 0.25 * model.mesh.nodes[n];
    within[t] = (centroid - near.centre).norm() <= near.radius;
  }
  return within;
}

std::shared_ptr<const CondensedTissue> condense(const TissueModel& model, const TissueState& state,
                                                std::span<const std::uint8_t> near) {
  auto of = std::make_shared<CondensedTissue>();
  of->tet = far_tets(model, state, near);
  std::vector<std::uint8_t> in_near(model.mesh.nodes.size(), 0), in_far(model.mesh.nodes.size(), 0);
  bool any_far = false;
  for (int t = 0; t < model.tets_in_use; ++t) {
    if (!state.alive[t]) continue;
    const bool far = of->tet[t] != 0;
    any_far = any_far || far;
    if (!far) of->near_tet.push_back(t);
    for (const int n : model.mesh.tets[t]) (far ? in_far : in_near)[n] = 1;
  }
  if (!any_far) return nullptr;
  if (of->near_tet.empty()) throw std::invalid_argument("nothing of the body is within the near region");
  of->near_node = nodes_where(in_near);
  if (model.condensed)
    for (const int n : model.condensed->node) in_far[n] = 1;
  of->place.assign(model.mesh.nodes.size(), -1);
  for (const int n : of->near_node) {
    if (!in_far[n] || model.fixed[n]) continue;
    of->place[n] = static_cast<int>(of->node.size());
    of->node.push_back(n);
    of->rest.push_back(model.mesh.nodes[n]);
  }
  Far alone(model, state, nodes_where(in_far), of->node, of->tet);
  const auto K = std::make_shared<const MatX>(alone.stiffness());
  of->stiffness = K;
  of->mass = alone.mass();
  of->load = alone.load();
  for (std::size_t i = 0; i < of->node.size(); ++i)
    of->load.segment<3>(3 * static_cast<Eigen::Index>(i)) -= of->mass[i] * model.gravity;
  return of;
}

void use_condensed(TissueModel& model, TissueState& state, std::shared_ptr<const CondensedTissue> far) {
  std::vector<std::uint8_t> near(model.mesh.nodes.size(), 0);
  for (const int n : far->near_node) near[n] = 1;
  for (int t = 0; t < model.tets_in_use; ++t) {
    if (!far->tet[t]) continue;
    state.alive[t] = 0;
    for (const int n : model.mesh.tets[t])
      if (!near[n]) model.fixed[n] = 1;
  }
  // A spring of the boundary is in K̂ already; those beyond hold nothing that is alive.
  for (const int n : far->node)
    if (!model.springs.empty()) model.springs[n] = {};
  model.condensed = std::move(far);
  refresh_mass(model, state);
}

void condense_far(TissueModel& model, TissueState& state, const NearRegion& near) {
  if (auto far = condense(model, state, tets_within(model, near)))
    use_condensed(model, state, std::move(far));
}

}  // namespace hapticd
