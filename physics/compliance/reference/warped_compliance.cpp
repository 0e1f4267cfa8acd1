#include "physics/compliance/reference/warped_compliance.h"

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string>

#include "physics/compliance/growing_order.h"
#include "physics/compliance/reference/low_rank_inverse.h"
#include "physics/compliance/reference/warp_rotation.h"
#include "physics/compliance/residual.h"

namespace hapticd {

namespace {

// Everything a reference factor is made from, copied, and what it is once made.
struct WarpedReference final : ReferenceFactor {
  ComplianceMethod method;
  SystemMatrix matrix;
  TissueState state;
  std::vector<int> order;
  std::vector<int> zone;  // last in the order; empty where METIS's own order was kept
  int cuts = 0;           // that its mesh has had
  int tets = 0;           // in use
  double identity_scale = 1;
  std::unique_ptr<LowRankInverse> inverse;

  WarpedReference(ComplianceMethod which, const SystemMatrix& pattern, TissueState from)
      : method(which), matrix(pattern), state(std::move(from)) {}

  void make() override {
    matrix.assemble(state);
    identity_scale = matrix.identity_scale();
    switch (method) {
      case ComplianceMethod::updown:
        inverse = make_updown_inverse(matrix, order, zone);
        break;
      case ComplianceMethod::lazy:
        inverse = make_lazy_inverse(matrix, order, zone);
        break;
      default:
        inverse = make_dense_inverse(matrix);
        break;
    }
  }
};

// Interface: ReferenceCompliance, or Compliance for `dense`, whose inverse nobody else makes.
template <class Interface>
class Warped : public Interface {
 public:
  Warped(ComplianceMethod method, const TissueModel& model, double h, const ComplianceOptions& options)
      : method_(method),
        model_(model),
        h_(h),
        options_(options),
        graph_(node_graph(model)),
        order_(fill_reducing_order(graph_)),
        matrix_(model, graph_, h),
        turn_(model),
        in_zone_(model.node_count(), 0) {}

  void move_zone(std::span<const int> nodes) override {
    std::vector<std::uint8_t> in_zone(in_zone_.size(), 0);
    std::vector<int> zone;
    for (const int n : nodes) {
      if (n < 0 || n >= model_.node_count())
        throw std::invalid_argument("the zone names node " + std::to_string(n));
      if (model_.fixed[n] || in_zone[n] || n >= model_.nodes_in_use) continue;
      in_zone[n] = 1;
      zone.push_back(n);
    }
    if (in_zone == in_zone_) return;
    in_zone_ = std::move(in_zone);
    zone_ = std::move(zone);
  }

  bool zone_covers(std::span<const int> nodes) const override {
    return std::all_of(nodes.begin(), nodes.end(), [&](int n) {
      return n >= 0 && n < model_.node_count() &&
             (in_zone_[n] || model_.fixed[n] || n >= model_.nodes_in_use || !needs_zone());
    });
  }

  void remove(const TissueState& after, std::span<const int> tets) override {
    if (!inverse_ || !mesh_is_current()) return;
    for (const int t : tets) {
      if (gone_[t] || after.alive[t]) continue;
      for (const int n : model_.mesh.tets[t]) {
        if (model_.fixed[n] || orphan_[n] || after.live_tets_of_node[n] > 0) continue;
        orphan_[n] = 1;
        change(identity_term(n, identity_scale_), TermSign::add);
      }
    }
    for (const int t : tets) {
      if (gone_[t] || after.alive[t]) continue;
      gone_[t] = 1;
      ++gone_count_;
      ++removed_since_reference_;
      Tet corners = model_.mesh.tets[t];
      std::sort(corners.begin(), corners.end(),
                [&](int a, int b) { return inverse_->place(a) < inverse_->place(b); });
      change(element_term(model_, h_, t, left_[t], turn_.reference()[t], corners), TermSign::take_out);
    }
  }

  // A new node joins the zone that it came from.
  void reshape(const TissueState&, std::span<const int> tets) override {
    const int known = order_.node_count();
    order_.follow(model_, matrix_.elements(), tets);
    for (int n = known; n < order_.node_count(); ++n) {
      if (model_.fixed[n] || in_zone_[n] || !in_zone_[order_.origin(n)]) continue;
      in_zone_[n] = 1;
      zone_.push_back(n);
    }
    turn_.reshape(tets);
    ++cuts_;
    updated_ = false;
  }

  void update(const TissueState& state) override {
    const Within factor(options_.times, StepPart::factor);
    updated_ = false;
    sampled_.reset();
    follow_mesh();
    if (inverse_ && state.removed != gone_count_) remove_untold(state);
    if (needs_new_reference(state)) {
      inverse_.reset();
      const std::unique_ptr<WarpedReference> reference = reference_of(state);
      reference->make();
      take(*reference);
    }
    present_ = state;
    turns_.clear();
    ++reference_age_;
    updated_ = true;
  }

  void apply(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    require_update();
    if (turns_.empty()) find_turns();
    const int nodes = matrix_.node_count();
    VecX x(3 * nodes);
    for (int n = 0; n < nodes; ++n) {
      if (in_system(n))
        x.segment<3>(3 * n) = turns_[n].transpose() * b.segment<3>(3 * n);
      else
        x.segment<3>(3 * n).setZero();
    }
    inverse_->apply(x);
    y.tail(y.size() - x.size()).setZero();  // nodes not in use
    for (int n = 0; n < nodes; ++n) {
      if (in_system(n))
        y.segment<3>(3 * n) = turns_[n] * x.segment<3>(3 * n);
      else
        y.segment<3>(3 * n).setZero();
    }
  }

  void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) override {
    require_update();
    if (!zone_covers(nodes)) throw std::invalid_argument("the patch leaves the zone of the last update");
    free_.clear();
    where_.clear();
    for (int k = 0; k < static_cast<int>(nodes.size()); ++k) {
      if (!in_system(nodes[k])) continue;
      free_.push_back(nodes[k]);
      where_.push_back(k);
    }
    const int count = static_cast<int>(free_.size());
    reference_block_.resize(3 * count, 3 * count);
    inverse_->patch(free_, reference_block_);
    std::vector<Mat3> Q(free_.size());
    for (int i = 0; i < count; ++i) Q[i] = turn_of(free_[i]);
    block.setZero();
    for (int i = 0; i < count; ++i)
      for (int j = 0; j <= i; ++j) {
        Mat3 entry = Q[i] * reference_block_.block<3, 3>(3 * i, 3 * j) * Q[j].transpose();
        if (i == j) entry.triangularView<Eigen::StrictlyUpper>() = entry.transpose();
        block.block<3, 3>(3 * where_[i], 3 * where_[j]) = entry;
        block.block<3, 3>(3 * where_[j], 3 * where_[i]) = entry.transpose();
      }
  }

  ComplianceReport report() override {
    require_update();
    ComplianceReport report;
    for (const int n : zone_)
      report.rotation_since_reference = std::max(report.rotation_since_reference, angle_of(turn_of(n)));
    if (!sampled_) {
      matrix_.assemble(present_);
      sampled_ = sample_error(*this, matrix_);
    }
    report.residual = sampled_->residual;
    report.error = sampled_->error;
    report.health = health_of(*sampled_, options_);
    if (report.health == ComplianceHealth::good &&
        report.rotation_since_reference > options_.reference_rotation_limit)
      report.health = ComplianceHealth::new_reference_wanted;
    report.removed_since_reference = removed_since_reference_;
    report.reference_age = reference_age_;
    report.memory_bytes = inverse_->memory_bytes();
    return report;
  }

 protected:
  std::unique_ptr<WarpedReference> reference_of(const TissueState& state) {
    follow_mesh();
    auto reference = std::make_unique<WarpedReference>(method_, matrix_, state);
    reference->cuts = cuts_;
    reference->tets = model_.tets_in_use;
    if (method_ == ComplianceMethod::lazy)
      std::fill(reference->state.rotation.begin(), reference->state.rotation.end(), Mat3::Identity());
    if (method_ == ComplianceMethod::dense) return reference;
    if (method_ == ComplianceMethod::lazy || needs_zone()) reference->zone = zone_;
    reference->order = zone_last_order(graph_, order_.order(), reference->zone);
    return reference;
  }

  void adopt(WarpedReference& reference, const TissueState& state) {
    if (reference.method != method_ || !reference.inverse)
      throw std::invalid_argument("not a made reference factor of this compliance");
    updated_ = false;
    if (reference.cuts != cuts_) return;  // of an older mesh: the next update makes one, or has
    take(reference);
    if (state.removed != gone_count_) remove_untold(state);
  }

 private:
  bool mesh_is_current() const { return mesh_cuts_ == cuts_; }

  // The system matrix of the mesh as it is now; what was made of an older one is of no use any more.
  void follow_mesh() {
    if (mesh_is_current()) return;
    mesh_cuts_ = cuts_;
    graph_ = node_graph(model_);
    matrix_ = SystemMatrix(model_, graph_, h_);
    inverse_.reset();
  }

  bool needs_zone() const {
    return method_ == ComplianceMethod::updown && options_.updown_order == NodeOrder::zone_last;
  }

  bool needs_new_reference(const TissueState& state) const {
    if (!inverse_ || failed_) return true;
    if (needs_zone() && reference_zone_ != in_zone_) return true;
    if (method_ == ComplianceMethod::lazy)
      return options_.lazy_reference_after > 0 && removed_since_reference_ >= options_.lazy_reference_after;
    if (method_ == ComplianceMethod::dense)
      for (int t = 0; t < model_.tet_count(); ++t)
        if (state.alive[t] && state.rotation[t] != turn_.reference()[t]) return true;
    return false;
  }

  void take(WarpedReference& reference) {
    inverse_ = std::move(reference.inverse);
    identity_scale_ = reference.identity_scale;
    turn_.set_reference(reference.state.rotation, reference.tets);
    gone_.resize(model_.tet_count());
    for (int t = 0; t < model_.tet_count(); ++t) gone_[t] = !reference.state.alive[t];
    left_ = reference.state.left;
    gone_count_ = reference.state.removed;
    orphan_.resize(model_.node_count());
    for (int n = 0; n < model_.node_count(); ++n) orphan_[n] = reference.state.live_tets_of_node[n] == 0;
    reference_zone_.assign(model_.node_count(), 0);
    for (const int n : reference.zone) reference_zone_[n] = 1;
    failed_ = false;
    removed_since_reference_ = reference_age_ = 0;
  }

  void remove_untold(const TissueState& state) {
    std::vector<int> untold;
    for (int t = 0; t < model_.tet_count(); ++t)
      if (!state.alive[t] && !gone_[t]) untold.push_back(t);
    remove(state, untold);
  }

  void change(const ElementTerm& term, TermSign sign) {
    if (!failed_) failed_ = !inverse_->change(term, sign);
  }

  void require_update() const {
    if (!updated_) throw std::runtime_error("the compliance was used before a successful update");
  }

  bool in_system(int node) const { return !model_.fixed[node] && present_.live_tets_of_node[node] > 0; }

  // By node, a patch needs few turns of many; of a piece, all tetrahedra.
  Mat3 turn_of(int node) {
    const Warping warping = options_.warping.value_or(Warping::node);
    if (warping == Warping::node && turns_.empty()) return turn_(node, present_);
    if (turns_.empty()) find_turns();
    return turns_[node];
  }

  void find_turns() { turn_.all(options_.warping.value_or(Warping::node), present_, turns_); }

  ComplianceMethod method_;
  const TissueModel& model_;
  double h_;
  ComplianceOptions options_;
  NodeGraph graph_;
  GrowingOrder order_;
  SystemMatrix matrix_;
  int cuts_ = 0;       // told
  int mesh_cuts_ = 0;  // that the matrix has had
  WarpRotation turn_;
  std::vector<int> zone_;
  std::vector<std::uint8_t> in_zone_;
  std::vector<std::uint8_t> reference_zone_;

  std::unique_ptr<LowRankInverse> inverse_;
  double identity_scale_ = 1;
  std::vector<std::uint8_t> gone_;    // per tetrahedron: not in the inverse
  std::vector<double> left_;          // … share that was there of it when the inverse was made
  std::vector<std::uint8_t> orphan_;  // per node: its row of the inverse's A is the identity's
  int gone_count_ = 0;
  bool failed_ = false;
  int removed_since_reference_ = 0;
  int reference_age_ = 0;

  TissueState present_;
  bool updated_ = false;
  std::vector<Mat3> turns_;  // per node at the last update; empty until needed
  std::optional<SampledError> sampled_;
  std::vector<int> free_;
  std::vector<int> where_;
  MatX reference_block_;
};

class WarpedReferenceCompliance final : public Warped<ReferenceCompliance> {
 public:
  using Warped::Warped;

  std::unique_ptr<ReferenceFactor> snapshot_reference(const TissueState& state) override {
    return reference_of(state);
  }

  void adopt_reference(std::unique_ptr<ReferenceFactor> reference, const TissueState& state) override {
    auto* made = dynamic_cast<WarpedReference*>(reference.get());
    if (!made) throw std::invalid_argument("not a made reference factor of this compliance");
    adopt(*made, state);
  }
};

}  // namespace

std::unique_ptr<ReferenceCompliance> make_warped_compliance(ComplianceMethod method, const TissueModel& model,
                                                            double h, const ComplianceOptions& options) {
  if (!(h > 0)) throw std::invalid_argument("the time step must be positive");
  return std::make_unique<WarpedReferenceCompliance>(method, model, h, options);
}

std::unique_ptr<Compliance> make_dense_compliance(const TissueModel& model, double h,
                                                  const ComplianceOptions& options) {
  if (!(h > 0)) throw std::invalid_argument("the time step must be positive");
  return std::make_unique<Warped<Compliance>>(ComplianceMethod::dense, model, h, options);
}

}  // namespace hapticd
