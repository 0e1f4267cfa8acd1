#include "physics/compliance/condense_far.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <stdexcept>

#include "physics/compliance/compliance.h"
#include "physics/tissue/fragments.h"

namespace hapticd {
namespace {

constexpr int least_held = 3;  // nodes that hold a part still

// Per tetrahedron.
std::vector<std::uint8_t> far_tets(const TissueModel& model, const TissueState& state,
                                   const NearRegion& near) {
  TissueState far;
  far.alive.assign(state.alive.size(), 0);
  for (int t = 0; t < model.tets_in_use; ++t) {
    Vec3 centroid = Vec3::Zero();
    for (const int n : model.mesh.tets[t]) centroid += 0.25 * model.mesh.nodes[n];
    far.alive[t] = (centroid - near.centre).norm() > near.radius;
  }
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

// The far tissue alone.
class Far {
 public:
  Far(const TissueModel& model, const TissueState& state, const CondensedTissue& of)
      : model_(model), of_(of), state_(state) {
    model_.dynamic = model_.corotational = false;
    state_.alive = of.tet;
    refresh_mass(model_, state_);
    compliance_ = make_exact_compliance(model_, 1);
    compliance_->move_zone(of.node);
    compliance_->update(state_);
  }

  MatX stiffness() const {
    const auto size = 3 * static_cast<Eigen::Index>(of_.node.size());
    MatX C(size, size);
    compliance_->patch(of_.node, C);
    MatX K = MatX::Identity(size, size);
    C.selfadjointView<Eigen::Lower>().llt().solveInPlace(K);
    return 0.5 * (K + K.transpose());
  }

  // Rows' sums of Ψᵀ M Ψ, the mean of the three directions.
  std::vector<double> mass(const MatX& K) const {
    std::vector<double> mass(of_.node.size(), 0.0);
    for (int c = 0; c < 3; ++c) {
      VecX e = VecX::Zero(K.rows());
      for (Eigen::Index i = c; i < e.size(); i += 3) e[i] = 1;
      VecX g = solve(spread(K * e));
      for (int n = 0; n < model_.node_count(); ++n) g.segment<3>(3 * n) *= state_.mass[n];
      const VecX of_b = K * at_boundary(solve(g));
      for (std::size_t i = 0; i < mass.size(); ++i) mass[i] += of_b[3 * static_cast<Eigen::Index>(i) + c] / 3;
    }
    for (double& m : mass) m = std::max(m, 0.0);
    return mass;
  }

  // Ψᵀ (f_ext + f_int) at rest.
  VecX load(const MatX& K) const {
    VecX f(3 * model_.node_count()), inner(f.size());
    external_forces(model_, state_, f);
    internal_forces(model_, state_, inner);
    return K * at_boundary(solve(f + inner));
  }

 private:
  VecX solve(const VecX& f) const {
    VecX y(f.size());
    compliance_->apply(f, y);
    return y;
  }
  VecX spread(const VecX& of_b) const {
    VecX all = VecX::Zero(3 * model_.node_count());
    for (std::size_t i = 0; i < of_.node.size(); ++i)
      all.segment<3>(3 * of_.node[i]) = of_b.segment<3>(3 * static_cast<Eigen::Index>(i));
    return all;
  }
  VecX at_boundary(const VecX& all) const {
    VecX of_b(3 * static_cast<Eigen::Index>(of_.node.size()));
    for (std::size_t i = 0; i < of_.node.size(); ++i)
      of_b.segment<3>(3 * static_cast<Eigen::Index>(i)) = all.segment<3>(3 * of_.node[i]);
    return of_b;
  }

  TissueModel model_;
  const CondensedTissue& of_;
  TissueState state_;
  std::unique_ptr<Compliance> compliance_;
};

}  // namespace

void condense_far(TissueModel& model, TissueState& state, const NearRegion& near) {
  auto of = std::make_shared<CondensedTissue>();
  of->tet = far_tets(model, state, near);
  const auto tets = model.tets_in_use, far = static_cast<int>(std::count(of->tet.begin(), of->tet.end(), 1));
  if (far == 0) return;
  if (far == tets) throw std::invalid_argument("nothing of the body is within the near region");

  std::vector<std::uint8_t> in_near(model.node_count(), 0), in_far(model.node_count(), 0);
  for (int t = 0; t < tets; ++t)
    for (const int n : model.mesh.tets[t]) (of->tet[t] ? in_far : in_near)[n] = 1;
  for (int t = 0; t < tets; ++t)
    if (!of->tet[t]) of->near_tet.push_back(t);
  for (int n = 0; n < model.node_count(); ++n)
    if (in_near[n]) of->near_node.push_back(n);
  of->place.assign(model.node_count(), -1);
  for (int n = 0; n < model.node_count(); ++n) {
    if (!in_near[n] || !in_far[n] || model.fixed[n]) continue;
    of->place[n] = static_cast<int>(of->node.size());
    of->node.push_back(n);
    of->rest.push_back(model.mesh.nodes[n]);
  }
  {
    const Far alone(model, state, *of);
    of->stiffness = alone.stiffness();
    of->mass = alone.mass(of->stiffness);
    of->load = alone.load(of->stiffness);
  }
  for (std::size_t i = 0; i < of->node.size(); ++i)
    of->load.segment<3>(3 * static_cast<Eigen::Index>(i)) -= of->mass[i] * model.gravity;

  for (int n = 0; n < model.nodes_in_use; ++n)
    if (in_far[n] && !in_near[n]) model.fixed[n] = 1;
  for (int t = 0; t < tets; ++t)
    if (of->tet[t]) state.alive[t] = 0;
  // A spring of the boundary is in K̂ already; those beyond hold nothing that is alive.
  for (const int n : of->node)
    if (!model.springs.empty()) model.springs[n] = {};
  model.condensed = std::move(of);
  refresh_mass(model, state);
}

}  // namespace hapticd
