// Method `zone`: which nodes, what was removed or cut, how far the tissue turned; the solves are
// zone_factor.h's.
#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "physics/compliance/reference/warp_rotation.h"
#include "physics/compliance/reference_compliance.h"
#include "physics/compliance/zone/wanted_zone.h"
#include "physics/compliance/zone/zone_factor.h"
#include "physics/compliance/zone/zone_reshaping.h"
#include "physics/compliance/zone/zone_sample.h"

namespace hapticd {

namespace {

class ZoneCompliance final : public ReferenceCompliance {
 public:
  ZoneCompliance(const TissueModel& model, double h, const ComplianceOptions& options)
      : model_(model),
        options_(options),
        meshes_(model, h),
        turn_(model),
        factor_(options.quantised_reference ? PanelPrecision::rounded : PanelPrecision::full),
        sample_(options),
        wanted_(model),
        Q_(model.node_count(), Mat3::Identity()),
        in_system_(model.node_count(), 0) {}

  void move_zone(std::span<const int> nodes) override { wanted_.move(nodes); }
  void move_halo(std::span<const int> nodes) override { wanted_.move_halo(nodes); }

  bool zone_covers(std::span<const int> nodes) const override {
    return std::all_of(nodes.begin(), nodes.end(), [&](int n) {
      return model_.fixed[n] || (reference_ ? reference_->zone_place(n) >= 0 : wanted_.has(n));
    });
  }

  void remove(const TissueState& after, std::span<const int> tets) override {
    if (!reference_) return;
    updated_ = forward_solved_ = false;
    for (const int t : tets) {
      if (gone_[t] || after.alive[t]) continue;
      gone_[t] = 1;
      ++removed_count_;
      ++removed_since_reference_;
      if (!reference_->is_inside(t)) carry(after, t);
    }
  }

  void reshape(const TissueState& after, std::span<const int> tets) override {
    updated_ = forward_solved_ = false;
    turn_.reshape(tets);
    const int known = meshes_.order().node_count();
    const std::vector<int> cut =
        meshes_.cut(reference_ ? reference_->elements() : meshes_.structure().matrix.elements(), tets);
    wanted_.follow_cut(meshes_.order(), known);
    if (reference_) follow_cut(after, cut);
  }

  void extend_zone(std::span<const int> nodes) override {
    joining_.insert(joining_.end(), nodes.begin(), nodes.end());
  }

  void update(const TissueState& state) override {
    const Within assembly(options_.times, StepPart::assembly);
    updated_ = forward_solved_ = false;
    if (!reference_) {
      make_now(state);
    } else if (state.removed != removed_count_) {
      remove_untold(state);
    }
    let_join(state);
    const bool overdue = not_carried_ > 0 || carried_count_ > options_.most_carried ||
                         reference_->appended() > options_.most_appended ||
                         reference_->taken_in() > options_.most_taken_in;
    if (spoilt_ || (overdue && options_.synchronous_reference)) make_now(state);
    follow(state);
    if (!factor_.factor_corner(state, Q_, in_system_, options_.times)) {
      // Only round-off can do this, where almost nothing holds a piece: start from the present A.
      make_now(state);
      follow(state);
      if (!factor_.factor_corner(state, Q_, in_system_, options_.times))
        throw std::runtime_error(
            "the system matrix A is not positive definite: a body (or a part cut from "
            "it) has neither mass nor support");
    }
    ++reference_age_;
    updated_ = true;
    if (sample_.due_after_update(reference_age_))
      sample_.take(sample_residual(*this, model_, state, meshes_.structure().h), Q_,
                   removed_count_ + meshes_.cuts());
  }

  bool forward_covers(std::span<const int> nodes) const override {
    return reference_ && std::all_of(nodes.begin(), nodes.end(),
                                     [&](int n) { return model_.fixed[n] || reference_->is_near(n); });
  }

  void apply(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    require_update();
    auto reach = ZoneFactor::Reach::corner;
    half_.x.setZero();
    for (int n = 0; n < model_.node_count(); ++n) {
      if (!in_system_[n]) continue;
      auto x = half_.x.segment<3>(3 * reference_->place(n));
      x.noalias() = Q_[n].transpose() * b.segment<3>(3 * n);
      if (reach == ZoneFactor::Reach::all || reference_->zone_place(n) >= 0 || !(x.array() != 0).any())
        continue;
      reach = reference_->is_near(n) ? ZoneFactor::Reach::last_panel : ZoneFactor::Reach::all;
    }
    factor_.forward(half_, reach);
    factor_.backward(half_);
    turn_back(half_.x, y);
  }

  Solved start_solve(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    require_update();
    started_.x.setZero(half_.x.size());
    for (int n = 0; n < model_.node_count(); ++n)
      if (in_system_[n])
        started_.x.segment<3>(3 * reference_->place(n)).noalias() = Q_[n].transpose() * b.segment<3>(3 * n);
    factor_.forward(started_, ZoneFactor::Reach::all);
    forward_solved_ = true;
    half_ = started_;
    factor_.backward_near(half_);
    turn_back_at(reference_->near(), y);
    return Solved::forward;
  }

  void finish_solve(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) override {
    require_update();
    if (!std::exchange(forward_solved_, false))
      throw std::runtime_error("no solve was started since the last update");
    auto reach = ZoneFactor::Reach::corner;
    half_.x.setZero();
    for (const int n : reference_->near()) {
      if (!in_system_[n]) continue;
      auto x = half_.x.segment<3>(3 * reference_->place(n));
      x.noalias() = Q_[n].transpose() * f.segment<3>(3 * n);
      if (reference_->zone_place(n) < 0 && (x.array() != 0).any()) reach = ZoneFactor::Reach::last_panel;
    }
    factor_.forward(half_, reach);
    started_.x += half_.x;
    started_.g += half_.g;
    factor_.backward(started_);
    turn_back(started_.x, y);
  }

  void apply_in_zone(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) override {
    require_update();
    auto corner = factor_.corner_of(half_.x);
    corner.setZero();
    for (const int n : reference_->corner())
      if (in_system_[n])
        half_.x.segment<3>(3 * reference_->place(n)).noalias() = Q_[n].transpose() * f.segment<3>(3 * n);
    factor_.solve_corner(corner);
    turn_back_at(reference_->corner(), y);
  }

  void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) override {
    require_update();
    places_.clear();
    for (const int n : nodes) {
      if (n < 0 || n >= model_.node_count())
        throw std::invalid_argument("the patch names node " + std::to_string(n));
      places_.push_back(in_system_[n] ? reference_->place(n) : -1);
    }
    factor_.patch(places_, block);
    for (std::size_t i = 0; i < nodes.size(); ++i)
      for (std::size_t j = 0; j <= i; ++j) {
        Mat3 entry = Q_[nodes[i]] * block.block<3, 3>(3 * i, 3 * j) * Q_[nodes[j]].transpose();
        if (i == j) entry.triangularView<Eigen::StrictlyUpper>() = entry.transpose();
        block.block<3, 3>(3 * i, 3 * j) = entry;
        block.block<3, 3>(3 * j, 3 * i) = entry.transpose();
      }
  }

  double disagreement(const TissueState& state, const VecX& y) override {
    require_update();
    VecX change = multiply_system_matrix(model_, state, meshes_.structure().h, y);
    apply(change, change);
    change -= y;
    return change.lpNorm<Eigen::Infinity>() / std::max(y.lpNorm<Eigen::Infinity>(), 1e-300);
  }

  ComplianceReport report() override {
    require_update();
    ComplianceReport report;
    report.rotation_since_reference = largest_turn_;
    const SampledError& sampled = sample_.error(*this);
    report.residual = sampled.residual;
    report.error = sampled.error;
    report.health = health_of(sampled, options_);
    if (report.health == ComplianceHealth::good &&
        (not_carried_ > 0 || !sample_.holds(Q_, removed_count_ + meshes_.cuts())))
      report.health = ComplianceHealth::new_reference_wanted;
    report.wants_reference = report.health == ComplianceHealth::degraded || not_carried_ > 0 ||
                             std::max(sampled.residual, sampled.error) > options_.reference_error_limit ||
                             report.rotation_since_reference > options_.reference_rotation_limit ||
                             reference_age_ > options_.reference_age_limit ||
                             carried_count_ > options_.reference_removed_limit ||
                             reference_->appended() > options_.most_appended / 2 ||
                             reference_->taken_in() > options_.most_taken_in / 8;
    report.removed_since_reference = removed_since_reference_;
    report.appended_since_reference = reference_->appended();
    report.taken_in_since_reference = reference_->taken_in();
    report.reference_age = reference_age_;
    report.memory_bytes = factor_.memory_bytes();
    return report;
  }

  std::unique_ptr<ReferenceFactor> snapshot_reference(const TissueState& state) override {
    return wanted_reference(state, std::move(retired_));
  }

  void adopt_reference(std::unique_ptr<ReferenceFactor> reference, const TissueState& state) override {
    auto* made = dynamic_cast<ZoneReference*>(reference.get());
    if (!made || !made->made()) throw std::invalid_argument("not a made reference factor of this compliance");
    reference.release();
    take(std::unique_ptr<ZoneReference>(made), state);
  }

 private:
  void turn_back(const VecX& x, Eigen::Ref<VecX> y) const {
    for (int n = 0; n < model_.node_count(); ++n) {
      if (in_system_[n])
        y.segment<3>(3 * n) = Q_[n] * x.segment<3>(3 * reference_->place(n));
      else
        y.segment<3>(3 * n).setZero();
    }
  }

  // half_.x of these nodes, zero elsewhere.
  void turn_back_at(std::span<const int> nodes, Eigen::Ref<VecX> y) const {
    y.setZero();
    for (const int n : nodes)
      if (in_system_[n]) y.segment<3>(3 * n) = Q_[n] * half_.x.segment<3>(3 * reference_->place(n));
  }

  void require_update() const {
    if (!updated_) throw std::runtime_error("the compliance was used before a successful update");
  }

  void make_now(const TissueState& state) {
    const Within factor(options_.times, StepPart::factor);
    auto reference = wanted_reference(state, nullptr);
    reference->make();
    take(std::move(reference), state);
  }

  int room() const {
    return std::min(options_.most_appended, meshes_.spare_nodes()) + options_.most_taken_in;
  }

  std::unique_ptr<ZoneReference> wanted_reference(const TissueState& state,
                                                  std::unique_ptr<ZoneReference> retired) const {
    return std::make_unique<ZoneReference>(meshes_.now(), wanted_.zone_and_halo(), wanted_.zone_size(),
                                           room(), state, options_.quantised_reference, std::move(retired));
  }

  void take(std::unique_ptr<ZoneReference> reference, const TissueState& state) {
    updated_ = forward_solved_ = false;
    retired_ = std::move(reference_);
    reference_ = std::move(reference);
    meshes_.made(reference_->mesh());
    turn_.set_reference(reference_->state().rotation, reference_->mesh().tets);
    sample_.forget();
    joining_.clear();
    factor_.set_reference(*reference_, room());
    gone_.resize(model_.tet_count());
    for (int t = 0; t < model_.tet_count(); ++t) gone_[t] = !reference_->state().alive[t];
    removed_count_ = reference_->state().removed;
    stayed_orphan_.assign(model_.node_count(), 0);
    for (int n = 0; n < model_.node_count(); ++n)
      stayed_orphan_[n] = reference_->state().live_tets_of_node[n] == 0;
    removed_since_reference_ = reference_age_ = carried_count_ = not_carried_ = 0;
    spoilt_ = false;
    if (reference_->mesh().cuts != meshes_.cuts())
      follow_cut(state, meshes_.cut_since(reference_->mesh().cuts));
    if (state.removed != removed_count_) remove_untold(state);
    removed_count_ = state.removed;
  }

  void follow_cut(const TissueState& after, std::span<const int> tets) {
    for (const int t : tets)
      if (reference_->elements()[t].node != no_tet) hold_orphans(after, reference_->elements()[t].node);
    spoilt_ =
        !follow_reshaped(*reference_, factor_, model_, after, turn_.reference(), gone_, tets) || spoilt_;
  }

  // Nodes that were asked for, as long as there is room.
  void let_join(const TissueState& state) {
    std::sort(joining_.begin(), joining_.end());
    joining_.erase(std::unique(joining_.begin(), joining_.end()), joining_.end());
    std::erase_if(joining_, [&](int n) {
      return model_.fixed[n] || reference_->zone_place(n) >= 0 || state.live_tets_of_node[n] == 0;
    });
    const int left = std::max(0, options_.most_taken_in - reference_->taken_in());
    if (std::ssize(joining_) > left) joining_.resize(left);
    if (!joining_.empty()) spoilt_ = !factor_.take_in(joining_, turn_.reference(), gone_) || spoilt_;
    joining_.clear();
  }

  void remove_untold(const TissueState& state) {
    std::vector<int> untold;
    for (int t = 0; t < model_.tet_count(); ++t)
      if (!state.alive[t] && !gone_[t]) untold.push_back(t);
    remove(state, untold);
  }

  // An element of the far field, or across the zone's edge, that just went.
  void carry(const TissueState& after, int t) {
    const Tet& nodes = model_.mesh.tets[t];
    const auto no_unknown = [&](int n) { return model_.fixed[n] || after.live_tets_of_node[n] == 0; };
    // Nothing that is left feels it: a fragment that went whole costs nothing.
    if (std::all_of(nodes.begin(), nodes.end(), no_unknown)) return;
    if (carried_count_ >= options_.most_carried) {
      ++not_carried_;
      return;
    }
    hold_orphans(after, nodes);
    Tet corners = nodes;
    std::sort(corners.begin(), corners.end(),
              [&](int a, int b) { return reference_->place(a) < reference_->place(b); });
    const ElementTerm term = element_term(model_, meshes_.structure().h, t, reference_->state().left[t],
                                          turn_.reference()[t], corners);
    not_carried_ += !factor_.carry(term, TermSign::take_out);
    ++carried_count_;
  }

  // An orphan outside the corner gets the identity's row before its last stiffness goes.
  void hold_orphans(const TissueState& after, const Tet& nodes) {
    for (const int n : nodes) {
      if (model_.fixed[n] || stayed_orphan_[n] || after.live_tets_of_node[n] > 0) continue;
      stayed_orphan_[n] = 1;
      if (reference_->zone_place(n) < 0)
        not_carried_ += !factor_.carry(identity_term(n, reference_->identity_scale()), TermSign::add);
    }
  }

  void follow(const TissueState& state) {
    half_.x.resize(static_cast<Eigen::Index>(3) * reference_->places());
    for (int n = 0; n < model_.node_count(); ++n)
      in_system_[n] = !model_.fixed[n] && state.live_tets_of_node[n] > 0;
    const Warping warping = options_.warping.value_or(Warping::piece);
    turn_.all(warping, state, Q_);
    largest_turn_ = 0;
    for (const int n : reference_->corner())
      if (in_system_[n])
        largest_turn_ =
            std::max(largest_turn_, warping == Warping::node ? angle_of(Q_[n])
                                                             : angle_of(turn_(n, state) * Q_[n].transpose()));
  }

  const TissueModel& model_;
  ComplianceOptions options_;
  ZoneMeshes meshes_;
  WarpRotation turn_;
  ZoneFactor factor_;
  ZoneSample sample_;
  WantedZone wanted_;

  std::unique_ptr<ZoneReference> reference_;
  std::unique_ptr<ZoneReference> retired_;  // freed by the next reference factor's maker, which has the time
  std::vector<std::uint8_t> gone_;          // per tetrahedron
  std::vector<std::uint8_t>
      stayed_orphan_;  // per node: its row of reference factor and terms is the identity's
  int removed_count_ = 0;
  int removed_since_reference_ = 0;
  int carried_count_ = 0;
  int not_carried_ = 0;
  bool spoilt_ = false;  // by round-off
  std::vector<int> joining_;
  int reference_age_ = 0;

  std::vector<Mat3> Q_;
  double largest_turn_ = 0;
  std::vector<std::uint8_t> in_system_;
  ZoneFactor::Half half_;     // scratch
  ZoneFactor::Half started_;  // of `start_solve`: its forward half
  bool forward_solved_ = false;
  std::vector<int> places_;
  bool updated_ = false;
};

}  // namespace

std::unique_ptr<ReferenceCompliance> make_zone_compliance(const TissueModel& model, double h,
                                                          const ComplianceOptions& options) {
  if (!(h > 0)) throw std::invalid_argument("the time step must be positive");
  return std::make_unique<ZoneCompliance>(model, h, options);
}

}  // namespace hapticd
