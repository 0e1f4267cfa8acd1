#include "physics/compliance/zone/zone_reference.h"

#include <algorithm>

#include "physics/compliance/factor/multifrontal_factor.h"
#include "physics/tissue/tetrahedron.h"
#include "physics/tissue/volume_barrier.h"

namespace hapticd {

ZoneStructure::ZoneStructure(const TissueModel& model, double step)
    : h(step), graph(node_graph(model)), fill_order(fill_reducing_order(graph)), matrix(model, graph, step) {}

ZoneReference::ZoneReference(std::shared_ptr<const ZoneStructure> structure, std::vector<int> zone_and_halo,
                             int zone, const TissueState& state, bool quantised_copy,
                             std::unique_ptr<ZoneReference> retired)
    : structure_(std::move(structure)),
      zone_and_halo_(std::move(zone_and_halo)),
      zone_(zone),
      quantised_copy_(quantised_copy),
      retired_(std::move(retired)) {
  state_.rotation = state.rotation;
  state_.alive = state.alive;
  state_.mass = state.mass;
  state_.live_tets_of_node = state.live_tets_of_node;
  state_.removed = state.removed;
}

void ZoneReference::make() {
  MultifrontalFactor factor;
  PageMemory quantised_memory;
  if (retired_) {
    factor.give_memory(retired_->panels_.take_values(), std::move(retired_->workspace_));
    quantised_memory = retired_->panels_.take_quantised_memory();
    retired_.reset();
  }
  SystemMatrix matrix = structure_->matrix;
  matrix.assemble(state_);
  identity_scale_ = matrix.identity_scale();
  const std::vector<std::uint8_t> live = matrix.live_edges(state_);
  const std::vector<int> order =
      zone_last_order(matrix.graph_of(live), structure_->fill_order, zone_and_halo_);
  rest_ = matrix.node_count() - zone_size();

  factor.set_order(matrix, order, live, static_cast<int>(zone_and_halo_.size()));
  factor.factor(matrix);
  place_.resize(order.size());
  for (int n = 0; n < matrix.node_count(); ++n) place_[n] = factor.place(n);
  MatX L_zz;
  factor.trailing_corner(zone_size(), L_zz);
  workspace_ = factor.take_workspace();
  panels_ = LeadingColumns(std::move(factor), 3 * rest_, quantised_copy_, std::move(quantised_memory));
  near_.clear();
  for (int n = 0; n < matrix.node_count(); ++n)
    if (is_near(n)) near_.push_back(n);
  S_out_.setZero(L_zz.rows(), L_zz.cols());
  S_out_.selfadjointView<Eigen::Lower>().rankUpdate(L_zz);

  find_inside();
  MatX A_in = MatX::Zero(S_out_.rows(), S_out_.cols());
  const std::vector<Mat3> unturned(matrix.node_count(), Mat3::Identity());
  add_inside(state_, unturned, A_in);
  S_out_.triangularView<Eigen::Lower>() -= A_in;
  made_ = true;
}

void ZoneReference::find_inside() {
  const auto& elements = structure_->matrix.elements();
  is_inside_.assign(elements.size(), 0);
  inside_.clear();
  for (int t = 0; t < static_cast<int>(elements.size()); ++t) {
    bool in = false;
    bool out = false;
    if (elements[t].node == no_tet) continue;
    for (const int n : elements[t].node) {
      if (structure_->matrix.fixed(n)) continue;
      in = in || zone_place(n) >= 0;
      out = out || zone_place(n) < 0;
    }
    is_inside_[t] = in && !out;
    if (is_inside_[t]) inside_.push_back(t);
  }
}

void ZoneReference::add_inside(const TissueState& now, std::span<const Mat3> Q,
                               Eigen::Ref<MatX, 0, Eigen::OuterStride<>> S) const noexcept {
  const SystemMatrix& matrix = structure_->matrix;
  for (const int t : inside_) {
    if (!now.alive[t]) continue;
    const SystemMatrix::Element& element = matrix.elements()[t];
    const Gradients b = now.rotation[t] * element.gradients;
    const double mass = matrix.lumped_mass(t);
    for (int i = 0; i < 4; ++i) {
      const int a = element.node[i];
      if (matrix.fixed(a)) continue;
      const int p = zone_place(a);
      for (int j = 0; j < 4; ++j) {
        const int c = element.node[j];
        const int q = zone_place(c);
        if (matrix.fixed(c) || q > p) continue;
        const Mat3 K = stiffness_block(b.col(i), b.col(j), element.volume, matrix.mu(), matrix.lambda());
        auto block = S.block<3, 3>(3 * p, 3 * q);
        block.noalias() += Q[a].transpose() * K * Q[c];
        if (p == q) block.diagonal().array() += mass;
      }
    }
  }
  for (const Collapsed& c : now.collapsed) {
    if (!is_inside_[c.tet] || !now.alive[c.tet]) continue;
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j) {
        const int a = c.node[i], b = c.node[j];
        if (matrix.fixed(a) || matrix.fixed(b) || zone_place(b) > zone_place(a)) continue;
        S.block<3, 3>(3 * zone_place(a), 3 * zone_place(b)).noalias() +=
            matrix.stiffness() * (Q[a].transpose() * barrier_block(c, i, j) * Q[b]);
      }
  }
}

}  // namespace hapticd
