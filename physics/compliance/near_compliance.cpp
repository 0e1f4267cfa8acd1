#include "physics/compliance/near_compliance.h"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include "physics/tissue/surface.h"

namespace hapticd {
namespace {

// The near model, and whose node and tetrahedron each of its own is.
struct NearModel {
  explicit NearModel(const TissueModel& whole) : of_node(whole.mesh.nodes.size(), -1) {
    const CondensedTissue& far = *whole.condensed;
    node = far.near_node;
    tet = far.near_tet;
    of_tet.assign(whole.mesh.tets.size(), -1);
    for (std::size_t k = 0; k < node.size(); ++k) of_node[node[k]] = static_cast<int>(k);
    for (std::size_t k = 0; k < tet.size(); ++k) of_tet[tet[k]] = static_cast<int>(k);

    model.material = whole.material;
    model.gravity = whole.gravity;
    model.corotational = whole.corotational;
    model.dynamic = whole.dynamic;
    for (const int n : node) {
      model.mesh.nodes.push_back(whole.mesh.nodes[n]);
      model.fixed.push_back(whole.fixed[n]);
      if (!whole.springs.empty()) model.springs.push_back(whole.springs[n]);
    }
    for (const int t : tet) {
      model.mesh.tets.push_back(near(whole.mesh.tets[t]));
      model.elastic.push_back(whole.elastic[t]);
      model.gradients.push_back(whole.gradients[t]);
      model.volume.push_back(whole.volume[t]);
    }
    model.across = faces_across(model.mesh.tets);
    model.parent.resize(tet.size());
    std::iota(model.parent.begin(), model.parent.end(), 0);
    model.nodes_in_use = static_cast<int>(node.size());
    model.tets_in_use = static_cast<int>(tet.size());

    auto condensed = std::make_shared<CondensedTissue>(far);
    condensed->place.assign(node.size(), -1);
    condensed->tet.assign(tet.size(), 0);
    condensed->near_node.resize(node.size());
    condensed->near_tet.resize(tet.size());
    std::iota(condensed->near_node.begin(), condensed->near_node.end(), 0);
    std::iota(condensed->near_tet.begin(), condensed->near_tet.end(), 0);
    for (std::size_t i = 0; i < far.node.size(); ++i) {
      condensed->node[i] = of_node[far.node[i]];
      condensed->place[condensed->node[i]] = static_cast<int>(i);
    }
    model.condensed = std::move(condensed);
    state = rest_state(model);
  }

  Tet near(const Tet& corners) const {
    Tet mine;
    for (int a = 0; a < 4; ++a) mine[a] = of_node[corners[a]];
    return mine;
  }

  // All that a compliance looks at.
  const TissueState& follow(const TissueState& whole) {
    for (std::size_t k = 0; k < tet.size(); ++k) {
      state.alive[k] = whole.alive[tet[k]];
      state.left[k] = whole.left[tet[k]];
      state.rotation[k] = whole.rotation[tet[k]];
    }
    for (std::size_t i = 0; i < node.size(); ++i) {
      state.mass[i] = whole.mass[node[i]];
      state.live_tets_of_node[i] = whole.live_tets_of_node[node[i]];
    }
    state.collapsed = whole.collapsed;
    for (Collapsed& c : state.collapsed) {
      c.tet = of_tet[c.tet];
      c.node = near(c.node);
    }
    state.removed = whole.removed;
    state.thinnings = whole.thinnings;
    return state;
  }

  const std::vector<int>& near_of(std::span<const int> of, const std::vector<int>& number) {
    list.clear();
    for (const int k : of) {
      if (k < 0 || k >= static_cast<int>(number.size()))
        throw std::invalid_argument("the body has no node or tetrahedron " + std::to_string(k));
      if (number[k] >= 0) list.push_back(number[k]);
    }
    return list;
  }
  const std::vector<int>& nodes(std::span<const int> of) { return near_of(of, of_node); }
  const std::vector<int>& tets(std::span<const int> of) { return near_of(of, of_tet); }

  VecX gather(const Eigen::Ref<const VecX>& b) const {
    VecX mine(3 * static_cast<Eigen::Index>(node.size()));
    for (std::size_t i = 0; i < node.size(); ++i)
      mine.segment<3>(3 * static_cast<Eigen::Index>(i)) =
          b.segment<3>(3 * static_cast<Eigen::Index>(node[i]));
    return mine;
  }
  void scatter(const VecX& mine, Eigen::Ref<VecX> y) const {
    y.setZero();
    for (std::size_t i = 0; i < node.size(); ++i)
      y.segment<3>(3 * static_cast<Eigen::Index>(node[i])) =
          mine.segment<3>(3 * static_cast<Eigen::Index>(i));
  }

  TissueModel model;
  TissueState state;
  std::vector<int> node, tet;        // of the body
  std::vector<int> of_node, of_tet;  // −1: not near
  std::vector<int> list;
};

// Base: Compliance or ReferenceCompliance.
template <class Base>
class NearCompliance : public Base {
 public:
  NearCompliance(const TissueModel& model,
                 const std::function<std::unique_ptr<Base>(const TissueModel&)>& make)
      : near_(model), inner_(make(near_.model)) {}

  void move_zone(std::span<const int> nodes) override { inner_->move_zone(near_.nodes(nodes)); }
  bool zone_covers(std::span<const int> nodes) const override { return covers(nodes, &Base::zone_covers); }
  void remove(const TissueState& after, std::span<const int> tets) override {
    inner_->remove(near_.follow(after), near_.tets(tets));
  }
  void update(const TissueState& state) override { inner_->update(near_.follow(state)); }
  void apply(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    VecX mine = near_.gather(b);
    inner_->apply(mine, mine);
    near_.scatter(mine, y);
  }
  void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) override {
    const std::vector<int> mine = near_.nodes(nodes);
    if (mine.size() == nodes.size()) return inner_->patch(mine, block);
    MatX known(3 * mine.size(), 3 * mine.size());
    inner_->patch(mine, known);
    std::vector<int> row;
    for (std::size_t k = 0; k < nodes.size(); ++k)
      for (int r = 0; r < 3; ++r)
        if (near_.of_node[static_cast<std::size_t>(nodes[k])] >= 0)
          row.push_back(static_cast<int>(3 * k) + r);
    block.setZero();
    for (std::size_t j = 0; j < row.size(); ++j)
      for (std::size_t i = 0; i < row.size(); ++i)
        block(row[i], row[j]) = known(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
  }
  ComplianceReport report() override { return inner_->report(); }

 protected:
  bool covers(std::span<const int> nodes, bool (Base::*does)(std::span<const int>) const) const {
    return std::all_of(nodes.begin(), nodes.end(), [&](int n) {
      const int mine = near_.of_node[static_cast<std::size_t>(n)];
      return mine < 0 || (inner_.get()->*does)(std::span(&mine, 1));
    });
  }

  NearModel near_;
  std::unique_ptr<Base> inner_;
};

class NearReferenceCompliance final : public NearCompliance<ReferenceCompliance> {
 public:
  using NearCompliance::NearCompliance;

  std::unique_ptr<ReferenceFactor> snapshot_reference(const TissueState& state) override {
    return inner_->snapshot_reference(near_.follow(state));
  }
  void adopt_reference(std::unique_ptr<ReferenceFactor> reference, const TissueState& state) override {
    inner_->adopt_reference(std::move(reference), near_.follow(state));
  }
  void move_halo(std::span<const int> nodes) override { inner_->move_halo(near_.nodes(nodes)); }
  void extend_zone(std::span<const int> nodes) override { inner_->extend_zone(near_.nodes(nodes)); }
  Solved start_solve(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    const VecX mine = near_.gather(b);
    VecX solved(mine.size());
    const Solved how = inner_->start_solve(mine, solved);
    near_.scatter(solved, y);
    return how;
  }
  void finish_solve(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) override {
    const VecX mine = near_.gather(f);
    VecX solved(mine.size());
    inner_->finish_solve(mine, solved);
    near_.scatter(solved, y);
  }
  bool forward_covers(std::span<const int> nodes) const override {
    return covers(nodes, &ReferenceCompliance::forward_covers);
  }
  void apply_in_zone(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) override {
    VecX mine = near_.gather(f);
    inner_->apply_in_zone(mine, mine);
    near_.scatter(mine, y);
  }
  double disagreement(const TissueState& state, const VecX& y) override {
    return inner_->disagreement(near_.follow(state), near_.gather(y));
  }
};

}  // namespace

std::unique_ptr<Compliance> make_near_compliance(
    const TissueModel& model, const std::function<std::unique_ptr<Compliance>(const TissueModel&)>& make) {
  return std::make_unique<NearCompliance<Compliance>>(model, make);
}

std::unique_ptr<ReferenceCompliance> make_near_reference_compliance(
    const TissueModel& model,
    const std::function<std::unique_ptr<ReferenceCompliance>(const TissueModel&)>& make) {
  return std::make_unique<NearReferenceCompliance>(model, make);
}

}  // namespace hapticd
