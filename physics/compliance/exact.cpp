#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#include "physics/compliance/compliance.h"
#include "physics/compliance/factor/cholmod_factor.h"
#include "physics/compliance/factor/multifrontal_factor.h"
#include "physics/compliance/growing_order.h"
#include "physics/compliance/patch_inverse.h"
#include "physics/compliance/residual.h"

namespace hapticd {

namespace {

template <class Factor>
class ExactCompliance final : public Compliance {
 public:
  ExactCompliance(const TissueModel& model, double h, const ComplianceOptions& options)
      : ExactCompliance(model, h, options, node_graph(model)) {}

  void move_zone(std::span<const int> nodes) override {
    std::vector<std::uint8_t> in_zone(in_zone_.size(), 0);
    std::vector<int> zone;
    for (const int n : nodes) {
      if (n < 0 || n >= static_cast<int>(in_zone.size()))
        throw std::invalid_argument("the zone names node " + std::to_string(n));
      if (model_.fixed[n] || in_zone[n] || n >= model_.nodes_in_use) continue;
      in_zone[n] = 1;
      zone.push_back(n);
    }
    if (in_zone == in_zone_) return;
    in_zone_ = std::move(in_zone);
    zone_ = std::move(zone);
    order_is_current_ = false;
  }

  bool zone_covers(std::span<const int> nodes) const override {
    const std::vector<std::uint8_t>& inside = factored_ ? in_corner_ : in_zone_;
    return std::all_of(nodes.begin(), nodes.end(),
                       [&](int n) { return inside[n] || model_.fixed[n] || n >= model_.nodes_in_use; });
  }

  // `update` sees from the state what went.
  void remove(const TissueState&, std::span<const int>) override {}

  // The new mesh is planned by the next update. A new node joins the zone that it came from.
  void reshape(const TissueState&, std::span<const int> tets) override {
    const int known = fill_order_.node_count();
    fill_order_.follow(model_, matrix_.elements(), tets);
    for (int n = known; n < fill_order_.node_count(); ++n) {
      if (model_.fixed[n] || !in_zone_[fill_order_.origin(n)] || in_zone_[n]) continue;
      in_zone_[n] = 1;
      zone_.push_back(n);
    }
    mesh_is_current_ = order_is_current_ = factored_ = false;
  }

  void update(const TissueState& state) override {
    // A of a linear body changes with what is there of it alone: its factor serves until the zone moves.
    const int changes = state.removed + state.thinnings;
    if (constant_ && factored_ && order_is_current_ && changes == changes_at_factor_) return;
    reported_ = false;
    changes_at_factor_ = changes;
    const Within factor_part(options_.times, StepPart::factor);
    if (!mesh_is_current_) matrix_ = SystemMatrix(model_, node_graph(model_), h_);
    mesh_is_current_ = true;
    if (!order_is_current_) {
      const std::vector<std::uint8_t> live = matrix_.live_edges(state);
      const NodeGraph graph = matrix_.graph_of(live);
      const std::vector<int> piece = connected_pieces(graph);
      std::stable_sort(zone_.begin(), zone_.end(), [&](int a, int b) { return piece[a] < piece[b]; });
      const std::vector<int> order = zone_last_order(graph, fill_order_.order(), zone_);
      if constexpr (std::is_same_v<Factor, MultifrontalFactor>)
        factor_.set_order(matrix_, order, live, static_cast<int>(zone_.size()), ZoneFronts::each_piece);
      else
        factor_.set_order(matrix_, order, live);
      order_is_current_ = true;
      in_corner_ = in_zone_;
      // Other nodes of a piece may come before its part of the zone, in one front with it.
      corner_nodes_ = 0;
      for (const int n : zone_)
        corner_nodes_ = std::max(corner_nodes_, matrix_.node_count() - factor_.place(n));
      pieces_.assign(1, 0);
      if constexpr (std::is_same_v<Factor, MultifrontalFactor>)
        pieces_ = factor_.corner_pieces(corner_nodes_);
    }
    factored_ = corner_is_current_ = false;
    {
      const Within assembly(options_.times, StepPart::assembly);
      matrix_.assemble(state);
    }
    factor_.factor(matrix_);
    factored_ = true;
  }

  void apply(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) override {
    require_factor();
    Eigen::Map<VecX> x = factor_.vector();
    for (int n = 0; n < matrix_.node_count(); ++n) {
      if (matrix_.in_system(n))
        x.segment<3>(3 * factor_.place(n)) = b.segment<3>(3 * n);
      else
        x.segment<3>(3 * factor_.place(n)).setZero();
    }
    factor_.solve();
    for (int n = 0; n < matrix_.node_count(); ++n) {
      if (matrix_.in_system(n))
        y.segment<3>(3 * n) = x.segment<3>(3 * factor_.place(n));
      else
        y.segment<3>(3 * n).setZero();
    }
    y.tail(y.size() - 3 * matrix_.node_count()).setZero();  // nodes not in use
  }

  void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) override {
    require_factor();
    const bool same = std::exchange(corner_is_current_, true);
    if (!same) factor_.trailing_corner(corner_nodes_, corner_);
    const int corner_start = matrix_.node_count() - corner_nodes_;
    places_.clear();
    outside_.clear();
    places_outside_.clear();
    for (const int n : nodes) {
      const bool known = n < matrix_.node_count() && matrix_.in_system(n), inside = known && in_corner_[n];
      if (known && !inside) {
        outside_.push_back(static_cast<int>(places_.size()));
        places_outside_.push_back(factor_.place(n));
      }
      places_.push_back(inside ? factor_.place(n) - corner_start : -1);
    }
    if (!outside_.empty()) factor_.half_solve(places_outside_, half_solved_);
    patch_inverse_(corner_, pieces_, places_, outside_, half_solved_, same, block);
  }

  ComplianceReport report() override {
    require_factor();
    // Nothing has changed since the sample, or the next is not due yet.
    if (reported_ || ++since_sample_ < options_.sample_every) return report_;
    since_sample_ = 0;
    const SampledError sampled = sample_error(*this, matrix_);
    report_.residual = sampled.residual;
    report_.error = sampled.error;
    report_.health = health_of(sampled, options_);
    report_.memory_bytes = factor_.memory_bytes();
    reported_ = constant_;
    return report_;
  }

 private:
  ExactCompliance(const TissueModel& model, double h, const ComplianceOptions& options,
                  const NodeGraph& graph)
      : model_(model),
        h_(h),
        options_(options),
        constant_(!model.corotational),
        fill_order_(fill_reducing_order(graph)),
        matrix_(model, graph, h),
        in_zone_(model.node_count(), 0),
        in_corner_(model.node_count(), 0) {}

  void require_factor() const {
    if (!factored_) throw std::runtime_error("the compliance was used before a successful update");
  }

  const TissueModel& model_;
  double h_;
  ComplianceOptions options_;
  bool constant_;  // A follows removals and thinning alone
  bool reported_ = false;
  ComplianceReport report_;
  int since_sample_ = std::numeric_limits<int>::max() / 2;  // reports
  int changes_at_factor_ = 0;                               // of what is there of the tissue
  GrowingOrder fill_order_;
  SystemMatrix matrix_;
  Factor factor_;
  PatchInverse patch_inverse_;
  std::vector<int> zone_;  // wanted of the next factor
  std::vector<std::uint8_t> in_zone_, in_corner_;
  int corner_nodes_ = 0;     // of the factor that there is
  std::vector<int> pieces_;  // … its corner's: PatchInverse
  std::vector<int> places_, outside_, places_outside_;
  MatX corner_, half_solved_;
  bool mesh_is_current_ = true;
  bool order_is_current_ = false;
  bool factored_ = false;
  bool corner_is_current_ = false;
};

}  // namespace

std::unique_ptr<Compliance> make_exact_compliance(const TissueModel& model, double h,
                                                  const ComplianceOptions& options) {
  if (!(h > 0)) throw std::invalid_argument("the time step must be positive");
  if (options.factorisation == Factorisation::cholmod)
    return std::make_unique<ExactCompliance<CholmodFactor>>(model, h, options);
  return std::make_unique<ExactCompliance<MultifrontalFactor>>(model, h, options);
}

}  // namespace hapticd
