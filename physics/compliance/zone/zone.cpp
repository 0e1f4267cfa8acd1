#include <algorithm>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "physics/compliance/factor/dense_factor.h"
#include "physics/compliance/patch_inverse.h"
#include "physics/compliance/reference/warp_rotation.h"
#include "physics/compliance/residual.h"
#include "physics/compliance/zone/far_field_updates.h"
#include "physics/compliance/zone/zone_reference.h"

#ifdef HAPTICD_OPENBLAS
extern "C" void openblas_set_num_threads(int threads);
#endif

namespace hapticd {

namespace {

class ZoneCompliance final : public Compliance {
 public:
  ZoneCompliance(const TissueModel& model, double h, const ComplianceOptions& options)
      : model_(model),
        options_(options),
        structure_(std::make_shared<const ZoneStructure>(model, h)),
        turn_(model),
        wanted_(model.node_count(), 0),
        Q_(model.node_count(), Mat3::Identity()),
        in_system_(model.node_count(), 0) {}

  void move_zone(std::span<const int> nodes) override {
    std::vector<std::uint8_t> wanted(model_.node_count(), 0);
    std::vector<int> zone;
    for (const int n : nodes) {
      if (n < 0 || n >= model_.node_count())
        throw std::invalid_argument("the zone names node " + std::to_string(n));
      if (model_.fixed[n] || wanted[n]) continue;
      wanted[n] = 1;
      zone.push_back(n);
    }
    wanted_ = std::move(wanted);
    wanted_zone_ = std::move(zone);
    ring_.clear();
  }

  void move_halo(std::span<const int> nodes) override {
    ring_.clear();
    for (const int n : nodes)
      if (!model_.fixed.at(n) && !wanted_[n]) ring_.push_back(n);
  }

  bool zone_covers(std::span<const int> nodes) const override {
    return std::all_of(nodes.begin(), nodes.end(), [&](int n) {
      return model_.fixed[n] || (reference_ ? reference_->zone_place(n) >= 0 : wanted_[n] != 0);
    });
  }

  void remove(const TissueState& after, std::span<const int> tets) override {
    if (!reference_) return;
    updated_ = is_begun_ = false;
    for (const int t : tets) {
      if (gone_[t] || after.alive[t]) continue;
      gone_[t] = 1;
      ++gone_count_;
      ++removed_since_reference_;
      if (!reference_->is_inside(t)) carry(after, t);
    }
  }

  void update(const TissueState& state) override {
    const Within assembly(options_.times, StepPart::assembly);
    updated_ = is_begun_ = false;
    if (!reference_) {
      make_now(state);
    } else if (state.removed != gone_count_) {
      remove_untold(state);
    }
    if (left_behind_ > 0 && options_.synchronous_reference) make_now(state);
    follow(state);
    if (!factor_corner(state)) {
      // Only round-off can do this, where almost nothing holds a piece: start from the present A.
      make_now(state);
      follow(state);
      if (!factor_corner(state))
        throw std::runtime_error(
            "the system matrix A is not positive definite: a body (or a part cut from "
            "it) has neither mass nor support");
    }
    ++reference_age_;
    // A step that has just paid for a new reference factor does not pay for a sample too.
    due_ = ++since_sample_ >= options_.sample_every && (reference_age_ > 1 || options_.sample_every <= 1);
    fresh_sample_ = false;
    updated_ = true;
    if (!due_) return;
    since_sample_ = 0;
    half_sample_ = sample_residual(*this, model_, state, structure_->h);
    Q_at_sample_ = Q_;
    removed_at_sample_ = gone_count_;
  }

  bool halves_cover(std::span<const int> nodes) const override {
    return reference_ && std::all_of(nodes.begin(), nodes.end(),
                                     [&](int n) { return model_.fixed[n] || reference_->is_near(n); });
  }

  void apply(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    require_update();
    Reach reach = Reach::corner;
    x_.setZero();
    for (int n = 0; n < model_.node_count(); ++n) {
      if (!in_system_[n]) continue;
      auto x = x_.segment<3>(3 * reference_->place(n));
      x.noalias() = Q_[n].transpose() * b.segment<3>(3 * n);
      if (reach == Reach::all || reference_->zone_place(n) >= 0 || !(x.array() != 0).any()) continue;
      reach = reference_->is_near(n) ? Reach::last_panel : Reach::all;
    }
    first_half(x_, g_, reach);
    second_half(x_, g_);
    turn_back(x_, y);
  }

  bool begin(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    require_update();
    begun_.setZero(x_.size());
    for (int n = 0; n < model_.node_count(); ++n)
      if (in_system_[n])
        begun_.segment<3>(3 * reference_->place(n)).noalias() = Q_[n].transpose() * b.segment<3>(3 * n);
    first_half(begun_, begun_g_, Reach::all);
    is_begun_ = true;
    x_ = begun_;
    g_ = begun_g_;
    from_corner(x_, g_);
    reference_->panels().backward_last(x_, precision());
    y.setZero();
    for (const int n : reference_->near())
      if (in_system_[n]) y.segment<3>(3 * n) = Q_[n] * x_.segment<3>(3 * reference_->place(n));
    return false;
  }

  void finish(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) override {
    require_update();
    if (!std::exchange(is_begun_, false))
      throw std::runtime_error("no solve was begun since the last update");
    Reach reach = Reach::corner;
    x_.setZero();
    for (const int n : reference_->near()) {
      if (!in_system_[n]) continue;
      auto x = x_.segment<3>(3 * reference_->place(n));
      x.noalias() = Q_[n].transpose() * f.segment<3>(3 * n);
      if (reference_->zone_place(n) < 0 && (x.array() != 0).any()) reach = Reach::last_panel;
    }
    first_half(x_, g_, reach);
    begun_ += x_;
    begun_g_ += g_;
    second_half(begun_, begun_g_);
    turn_back(begun_, y);
  }

  void apply_in_zone(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) override {
    require_update();
    auto corner = x_.tail(corner_size());
    corner.setZero();
    for (const int n : reference_->zone())
      if (in_system_[n])
        x_.segment<3>(3 * reference_->place(n)).noalias() = Q_[n].transpose() * f.segment<3>(3 * n);
    corner_factor().triangularView<Eigen::Lower>().solveInPlace(corner);
    corner_factor().triangularView<Eigen::Lower>().transpose().solveInPlace(corner);
    y.setZero();
    for (const int n : reference_->zone())
      if (in_system_[n]) y.segment<3>(3 * n) = Q_[n] * x_.segment<3>(3 * reference_->place(n));
  }

  void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) override {
    require_update();
    places_.clear();
    bool covered = true;
    for (const int n : nodes) {
      if (n < 0 || n >= model_.node_count())
        throw std::invalid_argument("the patch names node " + std::to_string(n));
      places_.push_back(in_system_[n] ? reference_->zone_place(n) : -1);
      covered = covered && (!in_system_[n] || places_.back() >= 0);
    }
    if (covered)
      patch_inverse_(corner_factor(), places_, block);
    else
      patch_beyond_zone(nodes, block);
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
    VecX change = multiply_system_matrix(model_, state, structure_->h, y);
    apply(change, change);
    change -= y;
    return change.lpNorm<Eigen::Infinity>() / std::max(y.lpNorm<Eigen::Infinity>(), 1e-300);
  }

  ComplianceReport report() override {
    require_update();
    ComplianceReport report;
    report.rotation_since_reference = largest_turn_;
    if (half_sample_ && !due_) {
      sampled_ = error_of(*this, *std::exchange(half_sample_, std::nullopt));
    } else if (due_ && !fresh_sample_) {
      // Where samples are rare, their halves fall into two steps.
      if (options_.sample_every <= 1) sampled_ = error_of(*this, *std::exchange(half_sample_, std::nullopt));
      fresh_sample_ = true;
    }
    report.residual = sampled_.residual;
    report.error = sampled_.error;
    report.health = health_of(sampled_, options_);
    if (report.health == ComplianceHealth::good && (left_behind_ > 0 || !sample_holds()))
      report.health = ComplianceHealth::new_reference_wanted;
    report.wants_reference = report.health == ComplianceHealth::degraded || left_behind_ > 0 ||
                             std::max(sampled_.residual, sampled_.error) > options_.reference_error_limit ||
                             report.rotation_since_reference > options_.reference_rotation_limit ||
                             reference_age_ > options_.reference_age_limit ||
                             carried_count_ > options_.reference_removed_limit;
    report.removed_since_reference = removed_since_reference_;
    report.reference_age = reference_age_;
    report.memory_bytes = reference_->panels().memory_bytes() + carried_.memory_bytes() +
                          2 * sizeof(double) * static_cast<std::size_t>(reference_->outer_corner().size());
    return report;
  }

  std::unique_ptr<ReferenceFactor> snapshot_reference(const TissueState& state) override {
    return wanted_reference(state, std::move(retired_));
  }

  void adopt_reference(std::unique_ptr<ReferenceFactor> reference, const TissueState& state) override {
    auto* made = dynamic_cast<ZoneReference*>(reference.get());
    if (!made || !made->made()) throw std::invalid_argument("not a made base of this compliance");
    reference.release();
    take(std::unique_ptr<ZoneReference>(made), state);
  }

 private:
  PanelPrecision precision() const {
    return options_.quantised_reference ? PanelPrecision::rounded : PanelPrecision::full;
  }

  // Where a right-hand side is not zero: from there on the panels have something to do.
  enum class Reach : std::uint8_t { corner, last_panel, all };

  // Up to L⁻¹ of the corner: all that a force on the zone does not enter before.
  void first_half(VecX& x, MatX& g, Reach reach) {
    if (reach == Reach::all) reference_->panels().forward(x, precision());
    if (reach == Reach::last_panel) reference_->panels().forward_last(x, precision());
    auto corner = x.tail(corner_size());
    Eigen::Map<MatX> column(x.data(), x.size(), 1);
    if (reach == Reach::corner || carried_.empty())
      g.setZero(carried_.columns(), 1);
    else
      carried_.before_corner(column, g, column.bottomRows(corner.size()));
    corner_factor().triangularView<Eigen::Lower>().solveInPlace(corner);
  }

  // … and from there on, but for the panels.
  void from_corner(VecX& x, MatX& g) {
    auto corner = x.tail(corner_size());
    Eigen::Map<MatX> column(x.data(), x.size(), 1);
    corner_factor().triangularView<Eigen::Lower>().transpose().solveInPlace(corner);
    if (!carried_.empty()) carried_.after_corner(column.bottomRows(corner.size()), g, column);
  }

  void second_half(VecX& x, MatX& g) {
    from_corner(x, g);
    reference_->panels().backward(x, precision());
  }

  void turn_back(const VecX& x, Eigen::Ref<VecX> y) const {
    for (int n = 0; n < model_.node_count(); ++n) {
      if (in_system_[n])
        y.segment<3>(3 * n) = Q_[n] * x.segment<3>(3 * reference_->place(n));
      else
        y.segment<3>(3 * n).setZero();
    }
  }

  DenseFactor::View corner_factor() noexcept { return factor_.matrix(); }
  Eigen::Index corner_size() const noexcept { return reference_->outer_corner().rows(); }

  void require_update() const {
    if (!updated_) throw std::runtime_error("the compliance was used before a successful update");
  }

  void make_now(const TissueState& state) {
    const Within factor(options_.times, StepPart::factor);
    auto reference = wanted_reference(state, nullptr);
    reference->make();
    take(std::move(reference), state);
  }

  std::unique_ptr<ZoneReference> wanted_reference(const TissueState& state,
                                                  std::unique_ptr<ZoneReference> retired) const {
    std::vector<int> nodes = wanted_zone_;
    nodes.insert(nodes.end(), ring_.begin(), ring_.end());
    return std::make_unique<ZoneReference>(structure_, std::move(nodes),
                                           static_cast<int>(wanted_zone_.size()), state,
                                           options_.quantised_reference, std::move(retired));
  }

  void take(std::unique_ptr<ZoneReference> reference, const TissueState& state) {
    updated_ = is_begun_ = false;
    retired_ = std::move(reference_);
    reference_ = std::move(reference);
    turn_.set_reference(reference_->state().rotation);
    half_sample_.reset();
    sampled_ = {};  // of the reference factor that went
    Q_at_sample_.clear();
    carried_.clear(3 * model_.node_count());
    x_.resize(3 * model_.node_count());
    factor_.resize(3 * reference_->zone_size());
    gone_.resize(model_.tet_count());
    for (int t = 0; t < model_.tet_count(); ++t) gone_[t] = !reference_->state().alive[t];
    gone_count_ = reference_->state().removed;
    stayed_orphan_.assign(model_.node_count(), 0);
    for (int n = 0; n < model_.node_count(); ++n)
      stayed_orphan_[n] = reference_->state().live_tets_of_node[n] == 0;
    removed_since_reference_ = reference_age_ = carried_count_ = left_behind_ = 0;
    if (state.removed != gone_count_) remove_untold(state);
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
      ++left_behind_;
      return;
    }
    // An orphan outside the corner gets the identity's row before its last stiffness goes.
    for (const int n : nodes) {
      if (model_.fixed[n] || stayed_orphan_[n] || after.live_tets_of_node[n] > 0) continue;
      stayed_orphan_[n] = 1;
      if (reference_->zone_place(n) < 0)
        change(identity_term(n, reference_->identity_scale()), FarFieldUpdates::Sign::add);
    }
    Tet corners = nodes;
    std::sort(corners.begin(), corners.end(),
              [&](int a, int b) { return reference_->place(a) < reference_->place(b); });
    change(element_term(model_, structure_->h, t, turn_.reference()[t], corners),
           FarFieldUpdates::Sign::take_out);
    ++carried_count_;
  }

  void change(const ElementTerm& term, FarFieldUpdates::Sign sign) {
    std::array<int, 4> places{};
    for (int c = 0; c < term.corners; ++c) places[c] = reference_->place(term.node[c]);
    if (!carried_.change(reference_->panels(), term, {places.data(), static_cast<std::size_t>(term.corners)},
                         sign, reference_->outer_corner()))
      ++left_behind_;
  }

  void follow(const TissueState& state) {
    for (int n = 0; n < model_.node_count(); ++n)
      in_system_[n] = !model_.fixed[n] && state.live_tets_of_node[n] > 0;
    const Warping warping = options_.warping.value_or(Warping::piece);
    turn_.all(warping, state, Q_);
    largest_turn_ = 0;
    for (const int n : reference_->zone())
      if (in_system_[n])
        largest_turn_ =
            std::max(largest_turn_, warping == Warping::node ? angle_of(Q_[n])
                                                             : angle_of(turn_(n, state) * Q_[n].transpose()));
  }

  bool factor_corner(const TissueState& state) {
    const MatX& S_out = reference_->outer_corner();
    auto S = factor_.matrix();
    for (Eigen::Index j = 0; j < S.cols(); ++j) {
      const Eigen::Index rows = S.rows() - j / row_multiple * row_multiple;  // whole tiles
      S.col(j).tail(rows) = S_out.col(j).tail(rows);
    }
    reference_->add_inside(state, Q_, S);
    for (const int n : reference_->zone()) {
      if (in_system_[n]) continue;
      const int p = 3 * reference_->zone_place(n);
      S.middleRows(p, 3).leftCols(p + 3).setZero();
      S.middleCols(p, 3).bottomRows(S.rows() - p).setZero();
      S.diagonal().segment<3>(p).setConstant(reference_->identity_scale());
    }
    const Within factor(options_.times, StepPart::factor);
    return factor_.factor();
  }

  // Nodes of which some lie outside the zone, by a half solve for each of those: with f the first half of a
  // solve for a unit force,  C_uu = f_uᵀ f_u over rest, Λ and corner,  C_cu = rows c of S⁻¹ (f_u before the
  // corner).
  void patch_beyond_zone(std::span<const int> nodes, Eigen::Ref<MatX> block) {
    std::vector<int> outside;  // indices into nodes
    std::vector<int> nonzero;
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      if (!in_system_[nodes[i]] || places_[i] >= 0) continue;
      outside.push_back(static_cast<int>(i));
      for (int r = 0; r < 3; ++r) nonzero.push_back(3 * reference_->place(nodes[i]) + r);
      places_[i] = -1;
    }
    patch_inverse_(corner_factor(), places_, block);  // rows and columns of those outside stay zero

    const auto columns = static_cast<Eigen::Index>(nonzero.size());
    if (beyond_.rows() != x_.size() || beyond_.cols() < columns) beyond_.setZero(x_.size(), columns);
    auto X = beyond_.leftCols(columns);
    for (std::size_t k = 0; k < nonzero.size(); ++k) X(nonzero[k], static_cast<Eigen::Index>(k)) = 1;
    std::vector<int> reached;
    reference_->panels().forward_sparse(X, nonzero, reached);
    const MatX X_r = X(reached, Eigen::all);
    MatX C_uu = X_r.transpose() * X_r;
    auto corner = X.bottomRows(corner_size());
    if (!carried_.empty()) {
      carried_.before_corner(X, g_, corner);
      carried_.add_energy(g_, C_uu);
    }
    corner_factor().triangularView<Eigen::Lower>().solveInPlace(corner);
    C_uu.noalias() += corner.transpose() * corner;
    corner_factor().triangularView<Eigen::Lower>().transpose().solveInPlace(corner);
    for (std::size_t u = 0; u < outside.size(); ++u) {
      const int at = 3 * outside[u];
      for (std::size_t w = 0; w < outside.size(); ++w)
        block.block<3, 3>(3 * outside[w], at) = C_uu.block<3, 3>(3 * w, 3 * u);
      for (std::size_t c = 0; c < nodes.size(); ++c) {
        if (places_[c] < 0) continue;
        const Mat3 entry = corner.block<3, 3>(3 * places_[c], 3 * u);
        block.block<3, 3>(3 * c, at) = entry;
        block.block<3, 3>(at, 3 * c) = entry.transpose();
      }
    }
    for (Eigen::Index k = 0; k < columns; ++k)
      for (const int row : reached) X(row, k) = 0;
    corner.setZero();
  }

  // Whether the last sample still speaks for this state: nothing turned or was carried since.
  bool sample_holds() const {
    if (half_sample_) return false;
    if (fresh_sample_) return true;
    if (Q_at_sample_.size() != Q_.size() || removed_at_sample_ != gone_count_) return false;
    const double still = 0.1 * options_.good_error;
    for (std::size_t n = 0; n < Q_.size(); ++n)
      if (!((Q_[n] - Q_at_sample_[n]).squaredNorm() < still * still)) return false;
    return true;
  }

  const TissueModel& model_;
  ComplianceOptions options_;
  std::shared_ptr<const ZoneStructure> structure_;
  WarpRotation turn_;
  std::vector<int> wanted_zone_;
  std::vector<int> ring_;
  std::vector<std::uint8_t> wanted_;

  std::unique_ptr<ZoneReference> reference_;
  std::unique_ptr<ZoneReference> retired_;  // freed by the next reference factor's maker, which has the time
  FarFieldUpdates carried_;
  std::vector<std::uint8_t> gone_;           // per tetrahedron
  std::vector<std::uint8_t>
      stayed_orphan_;  // per node: its row of reference factor and terms is the identity's
  int gone_count_ = 0;
  int removed_since_reference_ = 0;
  int carried_count_ = 0;
  int left_behind_ = 0;
  int reference_age_ = 0;

  std::vector<Mat3> Q_;
  double largest_turn_ = 0;
  std::vector<std::uint8_t> in_system_;
  DenseFactor factor_;  // of the fresh corner
  VecX x_;
  MatX g_;
  MatX beyond_;  // zero between uses
  VecX begun_;   // of `begin`: as first_half leaves it
  MatX begun_g_;
  bool is_begun_ = false;
  std::vector<int> places_;
  PatchInverse patch_inverse_;
  bool updated_ = false;

  int since_sample_ = std::numeric_limits<int>::max() / 2;  // updates
  bool due_ = false;
  bool fresh_sample_ = false;
  std::optional<ResidualSample> half_sample_;
  SampledError sampled_;
  std::vector<Mat3> Q_at_sample_;
  int removed_at_sample_ = 0;
};

}  // namespace

std::unique_ptr<Compliance> make_zone_compliance(const TissueModel& model, double h,
                                                 const ComplianceOptions& options) {
  if (!(h > 0)) throw std::invalid_argument("the time step must be positive");
#ifdef HAPTICD_OPENBLAS
  openblas_set_num_threads(1);
#endif
  return std::make_unique<ZoneCompliance>(model, h, options);
}

}  // namespace hapticd
