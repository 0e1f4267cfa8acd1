#include "physics/compliance/near_compliance.h"

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

namespace hapticd {
namespace {

// Base: Compliance or ReferenceCompliance.
template <class Base>
class NearCompliance : public Base {
 public:
  NearCompliance(std::unique_ptr<Submodel> near,
                 const std::function<std::unique_ptr<Base>(const TissueModel&)>& make)
      : near_(std::move(near)), inner_(make(near_->model)), told_(near_->tet.size(), 0) {}

  void move_zone(std::span<const int> nodes) override { inner_->move_zone(near_->nodes_of(nodes)); }
  bool zone_covers(std::span<const int> nodes) const override { return covers(nodes, &Base::zone_covers); }
  void remove(const TissueState& after, std::span<const int> tets) override {
    std::vector<int> went;
    for (const int t : near_->tets_of(tets))
      if (!std::exchange(told_[static_cast<std::size_t>(t)], std::uint8_t{1})) went.push_back(t);
    inner_->remove(near_->follow(after), went);
  }
  void update(const TissueState& state) override { inner_->update(near_->follow(state)); }
  void apply(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    VecX mine = near_->gather(b);
    inner_->apply(mine, mine);
    near_->scatter(mine, y);
  }
  void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) override {
    const std::vector<int> mine = near_->nodes_of(nodes);
    if (mine.size() == nodes.size()) return inner_->patch(mine, block);
    MatX known(3 * mine.size(), 3 * mine.size());
    inner_->patch(mine, known);
    std::vector<int> row;
    for (std::size_t k = 0; k < nodes.size(); ++k)
      for (int r = 0; r < 3; ++r)
        if (near_->of_node[static_cast<std::size_t>(nodes[k])] >= 0)
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
      const int mine = near_->of_node[static_cast<std::size_t>(n)];
      return mine < 0 || (inner_.get()->*does)(std::span(&mine, 1));
    });
  }

  std::unique_ptr<Submodel> near_;
  std::unique_ptr<Base> inner_;
  std::vector<std::uint8_t> told_;  // per tetrahedron: it went
};

class NearReferenceCompliance final : public NearCompliance<ReferenceCompliance> {
 public:
  using NearCompliance::NearCompliance;

  std::unique_ptr<ReferenceFactor> snapshot_reference(const TissueState& state) override {
    return inner_->snapshot_reference(near_->follow(state));
  }
  void adopt_reference(std::unique_ptr<ReferenceFactor> reference, const TissueState& state) override {
    inner_->adopt_reference(std::move(reference), near_->follow(state));
  }
  void move_halo(std::span<const int> nodes) override { inner_->move_halo(near_->nodes_of(nodes)); }
  void extend_zone(std::span<const int> nodes) override { inner_->extend_zone(near_->nodes_of(nodes)); }
  Solved start_solve(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    const VecX mine = near_->gather(b);
    VecX solved(mine.size());
    const Solved how = inner_->start_solve(mine, solved);
    near_->scatter(solved, y);
    return how;
  }
  void finish_solve(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) override {
    const VecX mine = near_->gather(f);
    VecX solved(mine.size());
    inner_->finish_solve(mine, solved);
    near_->scatter(solved, y);
  }
  bool forward_covers(std::span<const int> nodes) const override {
    return covers(nodes, &ReferenceCompliance::forward_covers);
  }
  void apply_in_zone(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) override {
    VecX mine = near_->gather(f);
    inner_->apply_in_zone(mine, mine);
    near_->scatter(mine, y);
  }
  double disagreement(const TissueState& state, const VecX& y) override {
    return inner_->disagreement(near_->follow(state), near_->gather(y));
  }
};

}  // namespace

std::unique_ptr<Compliance> make_near_compliance(
    std::unique_ptr<Submodel> near,
    const std::function<std::unique_ptr<Compliance>(const TissueModel&)>& make) {
  return std::make_unique<NearCompliance<Compliance>>(std::move(near), make);
}

std::unique_ptr<ReferenceCompliance> make_near_reference_compliance(
    std::unique_ptr<Submodel> near,
    const std::function<std::unique_ptr<ReferenceCompliance>(const TissueModel&)>& make) {
  return std::make_unique<NearReferenceCompliance>(std::move(near), make);
}

}  // namespace hapticd
