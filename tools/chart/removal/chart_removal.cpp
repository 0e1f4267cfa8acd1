#include "tools/chart/removal/chart_removal.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <numeric>

#include "physics/compliance/reference_compliance.h"
#include "physics/compliance/system_matrix.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

using Clock = std::chrono::steady_clock;

double us_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::micro>(Clock::now() - begin).count();
}

double median(std::vector<double> values) { return quantiles(std::move(values)).p50; }

// One method on one body, driven as the simulation drives it.
class Run {
 public:
  Run(const TissueModel& model, const ChartMethod& method, const ChartSettings& settings)
      : body_(model), method_(method), settings_(settings) {
    compliance_ = make_compliance(method.method, body_.model(), settings.h, method.options);
    references_ = as_reference_compliance(compliance_.get());
  }

  void start(const Vec3& tip) {
    move_zone(tip);
    const auto begin = Clock::now();
    compliance_->update(state());
    if (method_.keeps_reference || !method_.works_in_update) reference_ms_.push_back(1e-3 * us_since(begin));
    // The first calls fault their pages in.
    MatX block;
    for (int i = 0; i < 2; ++i) {
      if (method_.works_in_update) compliance_->update(state());
      condense(nearest_live_nodes(model(), state(), tip, settings_.patch_nodes), block);
    }
  }

  // Returns what telling it cost [µs]; of a cut, with the cutting of the mesh.
  double damage(const DamageStep& step) {
    const int nodes = model().nodes_in_use;
    auto begin = Clock::now();
    const std::span<const int> tets = body_.apply(step);
    if (tets.empty()) return 0;
    if (step.tet >= 0) {
      begin = Clock::now();
      compliance_->remove(state(), tets);
    } else {
      compliance_->reshape(state(), tets);
    }
    const double cost = us_since(begin);
    for (int n = nodes; n < model().nodes_in_use; ++n) in_zone_[n] = compliance_->zone_covers({&n, 1});
    appended_ += model().nodes_in_use - nodes;
    for (const int t : tets)
      carried_ += std::any_of(model().mesh.tets[t].begin(), model().mesh.tets[t].end(),
                              [&](int n) { return !model().fixed[n] && !in_zone_[n]; });
    return cost;
  }

  // Moves the zone when the patch has left it; for methods whose zone moves with a base, makes one.
  // Returns what of that falls into the step [µs].
  double follow(const Vec3& tip, std::span<const int> patch) {
    const bool covered = std::all_of(patch.begin(), patch.end(), [&](int n) { return in_zone_[n] != 0; });
    if (covered && carried_ < most_carried && appended_ < most_appended) return 0;
    move_zone(tip);
    if (!method_.keeps_reference) return 0;
    std::unique_ptr<ReferenceFactor> base = references_->snapshot_reference(state());
    auto begin = Clock::now();
    base->make();
    reference_ms_.push_back(1e-3 * us_since(begin));
    begin = Clock::now();
    references_->adopt_reference(std::move(base), state());
    adopt_us_.push_back(us_since(begin));
    carried_ = appended_ = 0;
    return adopt_us_.back();
  }

  double update() {
    const auto begin = Clock::now();
    compliance_->update(state());
    return us_since(begin);
  }

  double condense(std::span<const int> patch, MatX& block) {
    const auto size = static_cast<Eigen::Index>(3 * patch.size());
    block.resize(size, size);
    const auto begin = Clock::now();
    compliance_->patch(patch, block);
    return us_since(begin);
  }

  Compliance& compliance() { return *compliance_; }
  const TissueModel& model() const { return body_.model(); }
  const TissueState& state() const { return body_.state(); }

  ReferenceCost reference_cost() const {
    ReferenceCost cost{method_.name, method_.order, nodes_, static_cast<int>(reference_ms_.size()), 0, 0};
    cost.reference_ms_median = median(reference_ms_);
    cost.adopt_us_max = quantiles(adopt_us_).max;
    return cost;
  }

 private:
  static constexpr int most_carried = 48;  // elements not wholly inside the zone that a base carries here …
  static constexpr int most_appended = 64;  // … and new nodes

  void move_zone(const Vec3& tip) {
    const std::vector<int> zone = nearest_live_nodes(model(), state(), tip, settings_.zone_nodes);
    in_zone_.assign(model().node_count(), 0);
    for (const int n : zone) in_zone_[n] = 1;
    compliance_->move_zone(zone);
  }

  Specimen body_;
  int nodes_ = body_.model().nodes_in_use;  // to begin with
  const ChartMethod& method_;
  const ChartSettings& settings_;
  std::unique_ptr<Compliance> compliance_;
  ReferenceCompliance* references_ = nullptr;  // the same; null: it keeps no reference factor
  std::vector<std::uint8_t> in_zone_;
  int carried_ = 0, appended_ = 0;
  std::vector<double> reference_ms_, adopt_us_;
};

// What every method is compared with at the end of a point.
struct Checkpoint {
  std::vector<int> patch;
  MatX columns;
};

Checkpoint checkpoint(const TissueModel& model, const TissueState& state, const Vec3& tip,
                      const ChartSettings& settings) {
  Checkpoint result;
  result.patch = nearest_live_nodes(model, state, tip, settings.patch_nodes);
  const int columns = std::min(settings.error_columns, 3 * static_cast<int>(result.patch.size()));
  result.columns = oracle_columns(model, state, settings.h, result.patch, columns);
  return result;
}

}  // namespace

std::vector<ChartMethod> chart_methods() {
  const auto row = [](const char* name, const char* order, ComplianceMethod method) {
    ChartMethod m;
    m.name = name;
    m.order = order;
    m.method = method;
    // The error is sampled when asked, not in every step that is timed.
    m.options.sample_every = 1 << 30;
    return m;
  };
  ChartMethod exact = row("exact", "zone_last", ComplianceMethod::exact);
  ChartMethod zone = row("zone", "zone_last", ComplianceMethod::zone);
  exact.works_in_update = zone.works_in_update = true;
  ChartMethod updown = row("updown", "zone_last", ComplianceMethod::updown);
  zone.keeps_reference = updown.keeps_reference = true;
  ChartMethod metis = row("updown", "metis", ComplianceMethod::updown);
  metis.options.updown_order = NodeOrder::metis;
  const ChartMethod lazy = row("lazy", "zone_last", ComplianceMethod::lazy);
  ChartMethod rebased = row("lazy_rebased", "zone_last", ComplianceMethod::lazy);
  rebased.options.lazy_reference_after = 64;
  rebased.works_in_update = true;
  rebased.most_nodes = 8000;
  ChartMethod dense = row("dense", "none", ComplianceMethod::dense);
  dense.most_nodes = 1500;
  return {exact, zone, updown, metis, lazy, rebased, dense};
}

std::vector<int> nearest_live_nodes(const TissueModel& model, const TissueState& state, const Vec3& point,
                                    int count) {
  std::vector<std::pair<double, int>> near;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n] && state.live_tets_of_node[n] > 0)
      near.emplace_back((model.mesh.nodes[n] - point).squaredNorm(), n);
  const auto size = std::min(near.size(), static_cast<std::size_t>(count));
  std::partial_sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(size), near.end());
  std::vector<int> nodes(size);
  for (std::size_t i = 0; i < size; ++i) nodes[i] = near[i].second;
  return nodes;
}

MatX oracle_columns(const TissueModel& model, const TissueState& state, double h, std::span<const int> nodes,
                    int columns) {
  const Eigen::SparseMatrix<double> A = assemble_system_matrix(model, state, h);
  const auto fresh = make_compliance(ComplianceMethod::exact, model, h);
  fresh->update(state);
  MatX result(3 * nodes.size(), columns);
  VecX b(A.rows());
  VecX y(A.rows());
  VecX correction(A.rows());
  for (int c = 0; c < columns; ++c) {
    b.setZero();
    b[3 * nodes[c / 3] + c % 3] = 1;
    fresh->apply(b, y);
    for (int refinement = 0; refinement < 2; ++refinement) {
      fresh->apply(b - A * y, correction);
      y += correction;
    }
    for (std::size_t i = 0; i < nodes.size(); ++i) result.block<3, 1>(3 * i, c) = y.segment<3>(3 * nodes[i]);
  }
  return result;
}

RemovalChart chart_removals(const TissueModel& model, std::span<const DamageStep> steps,
                            std::span<const ChartMethod> methods, const ChartSettings& settings,
                            const std::function<bool(double, const std::string&)>& progress) {
  RemovalChart chart;
  const auto count = static_cast<int>(
      std::count_if(steps.begin(), steps.end(), [](const DamageStep& s) { return s.counts; }));
  if (count == 0) return chart;
  const int points = std::min(settings.points, count);
  const auto end_of = [&](int point) { return (point + 1) * count / points; };
  const double parts = static_cast<double>(methods.size()) + 1;

  std::vector<Checkpoint> oracle;
  Specimen body(model);
  auto next = steps.begin();
  for (int p = 0, k = 0; p < points; ++p) {
    for (; k < end_of(p); ++next) {
      body.apply(*next);
      k += next->counts;
    }
    oracle.push_back(checkpoint(body.model(), body.state(), std::prev(next)->tip, settings));
    if (!progress((p + 1) / (points * parts), "oracle")) return chart;
  }

  for (std::size_t m = 0; m < methods.size(); ++m) {
    const ChartMethod& method = methods[m];
    if (method.most_nodes > 0 && model.nodes_in_use > method.most_nodes) continue;
    const std::string label = method.name + (method.order == "metis" ? " (METIS)" : "");
    Run run(model, method, settings);
    run.start(steps.front().tip);
    next = steps.begin();
    MatX block;
    for (int p = 0, k = 0; p < points; ++p) {
      const int begin = k;
      const int stride = std::max(1, (end_of(p) - begin) / settings.timed_per_point);
      std::vector<double> updates, condenses, whole;
      double spent = 0;
      for (; k < end_of(p); ++next) {
        const Vec3& tip = next->tip;
        const double told = run.damage(*next);
        if (!next->counts) continue;
        ++k;
        const bool last = k == end_of(p);
        const bool enough = whole.size() >= 2 && spent > 1e6 * settings.seconds_per_point;
        const bool timed = last || ((k - 1 - begin) % stride == stride / 2 && !enough);
        if (!method.works_in_update) updates.push_back(told);
        if (!timed && !method.keeps_reference) continue;
        const std::vector<int> patch =
            nearest_live_nodes(run.model(), run.state(), tip, settings.patch_nodes);
        const double swap = run.follow(tip, patch);
        if (!timed) continue;
        const double updated = run.update();
        const double condensed = run.condense(patch, block);
        spent += updated + condensed;
        const double work = method.works_in_update ? told + swap + updated : told;
        if (method.works_in_update) updates.push_back(work);
        condenses.push_back(condensed);
        whole.push_back(work + condensed);
        if (!progress((1 + static_cast<double>(m) + static_cast<double>(k) / count) / parts, label))
          return chart;
      }
      const Quantiles update = quantiles(updates);
      RemovalPoint point;
      point.method = method.name;
      point.order = method.order;
      point.nodes = model.nodes_in_use;
      point.tets = model.tets_in_use;
      point.removed = k;
      point.update_us_median = update.p50;
      point.update_us_p99 = update.p99;
      point.condense_us_median = median(condenses);
      point.step_us_median = median(whole);
      point.timed = static_cast<int>(whole.size());
      point.patch_nodes = static_cast<int>(oracle[p].patch.size());
      run.condense(oracle[p].patch, block);
      const MatX& columns = oracle[p].columns;
      point.w_rel_error = (block.leftCols(columns.cols()) - columns).norm() / columns.norm();
      point.memory_mb = 1e-6 * static_cast<double>(run.compliance().report().memory_bytes);
      chart.points.push_back(point);
    }
    if (const ReferenceCost cost = run.reference_cost(); cost.made > 0) chart.bases.push_back(cost);
  }
  return chart;
}

std::optional<double> flatness(std::span<const RemovalPoint> points, const std::string& method,
                               const std::string& order, int nodes) {
  const RemovalPoint* first = nullptr;
  const RemovalPoint* last = nullptr;
  for (const RemovalPoint& p : points) {
    if (p.method != method || p.order != order || p.nodes != nodes) continue;
    if (!first) first = &p;
    last = &p;
  }
  if (first == last || !(first->step_us_median > 0)) return std::nullopt;
  return last->step_us_median / first->step_us_median;
}

std::optional<double> crossing(std::span<const RemovalPoint> points, const std::string& method,
                               const std::string& other, int nodes) {
  struct Pair {
    double removed, ours, theirs;
  };
  std::vector<Pair> pairs;
  for (const RemovalPoint& a : points)
    for (const RemovalPoint& b : points)
      if (a.method == method && b.method == other && a.nodes == nodes && b.nodes == nodes &&
          a.removed == b.removed)
        pairs.push_back({static_cast<double>(a.removed), a.step_us_median, b.step_us_median});
  if (pairs.empty() || pairs.back().ours >= pairs.back().theirs) return std::nullopt;
  std::size_t i = pairs.size() - 1;
  while (i > 0 && pairs[i - 1].ours < pairs[i - 1].theirs) --i;
  if (i == 0) return 0;
  const double before = pairs[i - 1].ours - pairs[i - 1].theirs;
  const double after = pairs[i].ours - pairs[i].theirs;
  return pairs[i - 1].removed + (pairs[i].removed - pairs[i - 1].removed) * before / (before - after);
}

}  // namespace hapticd
