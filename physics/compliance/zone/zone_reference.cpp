#include "physics/compliance/zone/zone_reference.h"

#include <algorithm>
#include <numeric>

#include "physics/compliance/factor/multifrontal_factor.h"
#include "physics/tissue/tetrahedron.h"
#include "physics/tissue/volume_barrier.h"

namespace hapticd {

// Tissue that splits. Let E be the elements as reference factor, corner and terms have them, and some e of E
// take new forms F(e): another corner, another shape, or several tetrahedra. Nodes that come into use are
// appended to the corner, S_out ← [S_out 0; 0 0].
//
//   nodes outside of what is cut:   are taken into the corner. A node of the rest is tied to a new one of the
//     corner; eliminating the old one and the force of the tie leaves the Schur complement on the zone and
//     the new nodes, as if these had been last in the order.
//   old outside, now all in the corner:   a_e(reference) is a summand of A_out between nodes of the corner
//     alone, so it is taken out of S_out as it is, and e is one of those inside.
//   old inside, new inside:   E and F(e) are in no S_out: A_in(reference) was taken out, and A_in(now) is
//     assembled at every step. So the new forms replace the old ones in that list, and nothing else changes.
//
// Definite: A_out is a sum of positive semi-definite elements throughout, each with its lumped mass, so
// A_out ≥ M_out, S_out ≥ M_out,corner ≥ 0 and S = Qᵀ A_in(now) Q + S_out ≥ M(now) as in the header; an
// appended node's mass is all in the elements that it has, which are inside.
ZoneReference::ZoneReference(ZoneMesh mesh, std::vector<int> zone_and_halo, int zone, int room,
                             const TissueState& state, bool quantised_copy,
                             std::unique_ptr<ZoneReference> retired)
    : mesh_(std::move(mesh)),
      zone_and_halo_(std::move(zone_and_halo)),
      zone_(zone),
      room_(room),
      quantised_copy_(quantised_copy),
      retired_(std::move(retired)) {
  state_.rotation = state.rotation;
  state_.alive = state.alive;
  state_.left = state.left;
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
  mesh_.make_structure();
  SystemMatrix matrix = mesh_.structure->matrix;
  matrix.assemble(state_);
  identity_scale_ = matrix.identity_scale();
  const std::vector<std::uint8_t> live = matrix.live_edges(state_);
  const std::vector<int> order =
      zone_last_order(matrix.graph_of(live), mesh_.structure->fill_order, zone_and_halo_);
  node_count_ = matrix.node_count();
  rest_ = node_count_ - zone_;

  factor.set_order(matrix, order, live, static_cast<int>(zone_and_halo_.size()));
  factor.factor(matrix);
  place_.resize(order.size());
  for (int n = 0; n < node_count_; ++n) place_[n] = factor.place(n);
  MatX L_zz;
  factor.trailing_corner(zone_, L_zz);
  workspace_ = factor.take_workspace();
  panels_ = LeadingColumns(std::move(factor), 3 * rest_, quantised_copy_, std::move(quantised_memory));
  corner_.reserve(zone_ + room_);
  corner_.assign(zone_and_halo_.begin(), zone_and_halo_.begin() + zone_);
  near_.clear();
  for (int n = 0; n < node_count_; ++n)
    if (is_near(n)) near_.push_back(n);
  near_.reserve(near_.size() + room_);
  known_nodes_ = node_count_;
  S_out_.setZero(L_zz.rows() + 3 * room_, L_zz.cols() + 3 * room_);
  auto S_out = outer_corner();
  S_out.selfadjointView<Eigen::Lower>().rankUpdate(L_zz);

  elements_ = matrix.elements();
  fixed_ = matrix.fixed();
  place_.resize(fixed_.size(), -1);
  is_inside_.assign(elements_.size(), 0);
  inside_.clear();
  for (int t = 0; t < static_cast<int>(elements_.size()); ++t) {
    is_inside_[t] = elements_[t].node != no_tet && lies_inside(elements_[t]);
    if (is_inside_[t]) inside_.push_back(t);
  }
  list_outside();
  MatX A_in = MatX::Zero(L_zz.rows(), L_zz.cols());
  add_inside(state_, {}, A_in);
  S_out.triangularView<Eigen::Lower>() -= A_in;
  made_ = true;
}

void ZoneReference::list_outside() {
  outside_first_.assign(static_cast<std::size_t>(node_count_) + 1, 0);
  const auto each_place = [&](const auto& visit) {
    for (int t = 0; t < static_cast<int>(elements_.size()); ++t) {
      if (is_inside_[t] || elements_[t].node == no_tet) continue;
      for (const int n : elements_[t].node)
        if (!fixed_[n] && zone_place(n) < 0) visit(t, static_cast<std::size_t>(n));
    }
  };
  each_place([&](int, std::size_t n) { ++outside_first_[n + 1]; });
  std::partial_sum(outside_first_.begin(), outside_first_.end(), outside_first_.begin());
  outside_.resize(static_cast<std::size_t>(outside_first_.back()));
  std::vector<int> next(outside_first_);
  each_place([&](int t, std::size_t n) { outside_[static_cast<std::size_t>(next[n]++)] = t; });
}

bool ZoneReference::lies_inside(const SystemMatrix::Element& element) const noexcept {
  bool in = false;
  for (const int n : element.node) {
    if (fixed_[n]) continue;
    if (zone_place(n) < 0) return false;
    in = true;
  }
  return in;
}

void ZoneReference::join(int node) {
  place_[node] = places();
  corner_.push_back(node);
}

void ZoneReference::append(const TissueModel& model) {
  for (; known_nodes_ < model.nodes_in_use; ++known_nodes_) {
    join(known_nodes_);
    near_.push_back(known_nodes_);
    fixed_[known_nodes_] = model.fixed[known_nodes_];
  }
  make_room();
}

void ZoneReference::take_in(std::span<const int> nodes) {
  for (const int n : nodes) {
    if (!is_near(n)) near_.push_back(n);
    join(n);
  }
  make_room();
}

void ZoneReference::take_in_elements(std::span<const int> nodes, std::span<const Mat3> rotation,
                                     std::span<const std::uint8_t> gone) {
  auto S_out = outer_corner();
  for (const int n : nodes)
    for (int k = outside_first_[n]; k < outside_first_[n + 1]; ++k) {
      const int t = outside_[k];
      if (is_inside_[t] || gone[t] || !lies_inside(elements_[t])) continue;
      add_element(t, state_.left[t], rotation[t], {}, -1, S_out);
      is_inside_[t] = 1;
      inside_.push_back(t);
    }
}

void ZoneReference::make_room() {
  const auto size = static_cast<Eigen::Index>(3 * corner_.size());
  if (size <= S_out_.rows()) return;
  const Eigen::Index before = S_out_.rows();
  MatX grown = MatX::Zero(size + before / 4, size + before / 4);
  grown.topLeftCorner(before, before) = S_out_;
  S_out_ = std::move(grown);
}

void ZoneReference::reshape(int tet, const SystemMatrix::Element& form) {
  elements_[tet] = form;
  if (!is_inside_[tet]) inside_.push_back(tet);
  is_inside_[tet] = 1;
}

void ZoneReference::add_element(int t, double left, const Mat3& rotation, std::span<const Mat3> Q,
                                double sign, Eigen::Ref<MatX, 0, Eigen::OuterStride<>> S) const noexcept {
  const SystemMatrix& matrix = law();
  const SystemMatrix::Element& element = elements_[t];
  const Gradients b = rotation * element.gradients;
  const double mass = sign * left * matrix.lumped_mass(element), volume = sign * left * element.volume;
  for (int i = 0; i < 4; ++i) {
    const int a = element.node[i];
    if (fixed_[a]) continue;
    const int p = zone_place(a);
    for (int j = 0; j < 4; ++j) {
      const int c = element.node[j];
      const int q = zone_place(c);
      if (fixed_[c] || q > p) continue;
      const Mat3 K = stiffness_block(b.col(i), b.col(j), volume, matrix.mu(element), matrix.lambda(element));
      auto block = S.block<3, 3>(3 * p, 3 * q);
      if (Q.empty())
        block += K;
      else
        block.noalias() += Q[a].transpose() * K * Q[c];
      if (p == q) block.diagonal().array() += mass;
    }
  }
}

void ZoneReference::add_inside(const TissueState& now, std::span<const Mat3> Q,
                               Eigen::Ref<MatX, 0, Eigen::OuterStride<>> S) const noexcept {
  const SystemMatrix& matrix = law();
  for (const int t : inside_)
    if (now.alive[t]) add_element(t, now.left[t], now.rotation[t], Q, 1, S);
  for (const Collapsed& c : now.collapsed) {
    if (!is_inside_[c.tet] || !now.alive[c.tet] || !same_corners(elements_[c.tet].node, c.node)) continue;
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j) {
        const int a = c.node[i], b = c.node[j];
        if (fixed_[a] || fixed_[b] || zone_place(b) > zone_place(a)) continue;
        S.block<3, 3>(3 * zone_place(a), 3 * zone_place(b)).noalias() +=
            matrix.stiffness() * (Q[a].transpose() * barrier_block(c, i, j) * Q[b]);
      }
  }
}

}  // namespace hapticd
