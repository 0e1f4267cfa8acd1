// Not a test: times of Compliance::reshape along a blade's way through a lens. Run by
//   test_tools --gtest_also_run_disabled_tests --gtest_filter='*CutTiming*'
#include <gtest/gtest.h>

#include <ctime>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "tests/physics/compliance/cut_by_hand.h"
#include "tools/chart/chart.h"
#include "tools/chart/removal/chart_removal.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

// Processor time of this thread: the machine may have other work.
double now_us() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

template <class Work>
void timed(std::vector<double>& us, const Work& work) {
  const double begin = now_us();
  work();
  us.push_back(now_us() - begin);
}

void report(const char* what, const std::vector<double>& us) {
  if (us.empty()) return;
  const std::size_t tenth = std::max<std::size_t>(1, us.size() / 10);
  const auto mean = [&](std::size_t from) {
    double sum = 0;
    for (std::size_t i = from; i < from + tenth; ++i) sum += us[i];
    return sum / static_cast<double>(tenth);
  };
  const Quantiles q = quantiles(us);
  std::printf(
      "%-28s %6zu  p50 %8.1f  p99 %8.1f  max %8.1f us  mean of last tenth / first %6.1f / %6.1f = %.2f\n",
      what, us.size(), q.p50, q.p99, q.max, mean(us.size() - tenth), mean(0),
      mean(us.size() - tenth) / mean(0));
}

// The simulation's part of method zone or exact, driven along a way; reference factors come `late` cuts late.
class Drive {
 public:
  Drive(TissueModel& model, ComplianceMethod method) : model_(model), state_(rest_state(model)) {
    ComplianceOptions options;
    options.sample_every = 1 << 30;
    options.synchronous_reference = false;
    compliance_ = make_compliance(method, model, 0.02, options);
    references_ = as_reference_compliance(compliance_.get());
  }

  void start(const Vec3& tip) {
    compliance_->move_zone(near(tip, zone_nodes));
    for (int i = 0; i < 3; ++i) compliance_->update(state_);
  }

  // `adopted`, `used`: where the tip will be when a reference factor wanted now comes into use, and in its
  // midst.
  void told(const Vec3& tip, const Vec3& adopted, const Vec3& used, const std::vector<int>& tets) {
    const std::vector<int> patch = near(tip, 60);
    timed(reshape, [&] { compliance_->reshape(state_, tets); });
    if (!references_) compliance_->move_zone(near(tip, zone_nodes));
    timed(update, [&] { compliance_->update(state_); });
    timed(again, [&] { compliance_->update(state_); });
    MatX block(3 * patch.size(), 3 * patch.size());
    timed(condense, [&] { compliance_->patch(patch, block); });
    if (references_) follow(adopted, used);
  }

  double error(const Vec3& tip) {
    const std::vector<int> patch = near(tip, 60);
    compliance_->update(state_);
    MatX block(3 * patch.size(), 3 * patch.size());
    compliance_->patch(patch, block);
    const MatX columns = oracle_columns(model_, state_, 0.02, patch, 12);
    return (block.leftCols(12) - columns).norm() / columns.norm();
  }

  const TissueState& state() const { return state_; }
  TissueState& state() { return state_; }
  static constexpr int zone_nodes = 160, late = 6;
  std::vector<double> reshape, update, again, condense, snapshot, make, adopt;
  int largest_appended = 0;

 private:
  std::vector<int> near(const Vec3& tip, int count) const {
    return nearest_live_nodes(model_, state_, tip, count);
  }

  void follow(const Vec3& adopted, const Vec3& used) {
    const ComplianceReport said = compliance_->report();
    largest_appended = std::max(largest_appended, said.appended_since_reference);
    if (reference_) {
      if (++waited_ < late) return;
      reference_->make();
      timed(adopt, [&] { references_->adopt_reference(std::move(reference_), state_); });
      compliance_->update(state_);
      return;
    }
    if (!said.wants_reference && compliance_->zone_covers(near(adopted, 60))) return;
    compliance_->move_zone(near(used, zone_nodes));
    timed(snapshot, [&] { reference_ = references_->snapshot_reference(state_); });
    waited_ = 0;
  }

  TissueModel& model_;
  TissueState state_;
  std::unique_ptr<Compliance> compliance_;
  ReferenceCompliance* references_ = nullptr;
  std::unique_ptr<ReferenceFactor> reference_;
  int waited_ = 0;
};

// The free nodes by cells across the lens, plane by plane and up and down: a blade's tip on its way, from
// each to one nearby.
std::vector<int> way_through(const TissueModel& model, double cell) {
  const Vec3 low = model.mesh.nodes[0] - Vec3(1, 1, 1);
  std::vector<std::pair<std::array<double, 3>, int>> sorted;
  for (int n = 0; n < model.nodes_in_use; ++n) {
    if (model.fixed[n]) continue;
    const Vec3 x = model.mesh.nodes[n] - low;
    const double plane = std::floor(x.y() / cell);
    const double column = (std::fmod(plane, 2) == 0 ? 1 : -1) * std::floor(x.x() / cell);
    sorted.push_back({{plane, column, (std::fmod(column, 2) == 0 ? 1 : -1) * x.z()}, n});
  }
  std::sort(sorted.begin(), sorted.end());
  std::vector<int> way;
  for (const auto& [place, n] : sorted) way.push_back(n);
  return way;
}

void drive(const char* lens, ComplianceMethod method, int count) {
  TissueModel read = read_lens(lens);
  const std::vector<int> fixed = read.mesh.group("zonule")->nodes;
  read.mesh.nodes.resize(read.nodes_in_use);
  read.mesh.tets.resize(read.tets_in_use);
  TissueModel model =
      make_tissue_model(std::move(read.mesh), read.material, fixed, Vec3::Zero(), {2 * count, 6 * count});
  std::vector<int> way = way_through(model, 7e-4);
  Drive drive(model, method);
  drive.start(model.mesh.nodes[way[0]]);
  std::printf("lens %s: %d nodes, %d tetrahedra, method %s\n", lens, model.nodes_in_use, model.tets_in_use,
              method == ComplianceMethod::zone ? "zone" : "exact");
  const auto at = [&](std::size_t k) { return model.mesh.nodes[way[std::min(k, way.size() - 1)]]; };
  const auto report_all = [&] {
    report("  reshape", drive.reshape);
    report("  update", drive.update);
    report("  update, nothing cut", drive.again);
    report("  patch of 60", drive.condense);
    report("  snapshot_reference", drive.snapshot);
    report("  adopt_reference", drive.adopt);
    for (auto* list :
         {&drive.reshape, &drive.update, &drive.again, &drive.condense, &drive.snapshot, &drive.adopt})
      list->clear();
  };
  int opened = 0;
  Vec3 tip = model.mesh.nodes[way[0]];
  for (std::size_t k = 0; opened < count && k < way.size(); ++k) {
    const std::vector<int> tets = by_hand::open_node(model, drive.state(), way[k], Vec3(0.05, 1, 0.02));
    if (tets.empty()) continue;
    tip = model.mesh.nodes[way[k]];
    drive.told(tip, at(k + Drive::late), at(k + 3 * Drive::late / 2), tets);
    ++opened;
  }
  std::printf("%d openings, at most %d nodes appended, error of C_pp %.1e\n", opened, drive.largest_appended,
              drive.error(tip));
  report_all();

  // The same way again: an edge at each node.
  int split = 0, edges = 0;
  way = way_through(model, 7e-4);
  for (std::size_t k = 0; split < count && k < way.size(); ++k) {
    const std::vector<int> star = by_hand::around(model, drive.state(), way[k], way[k]);
    if (star.empty()) continue;
    int other = -1;
    for (const int n : model.mesh.tets[star[0]])
      if (n != way[k] && !model.fixed[n]) other = n;
    if (other < 0) continue;
    const std::vector<int> tets = by_hand::split_edge(model, drive.state(), way[k], other);
    if (tets.empty()) continue;
    tip = model.mesh.nodes[way[k]];
    drive.told(tip, at(k + Drive::late), at(k + 3 * Drive::late / 2), tets);
    ++edges;
    split += static_cast<int>(tets.size()) / 2;
  }
  std::printf(
      "%d elements split by %d edges, at most %d nodes appended, error of C_pp %.1e; now %d nodes, %d "
      "tetrahedra\n",
      split, edges, drive.largest_appended, drive.error(tip), model.nodes_in_use, model.tets_in_use);
  report_all();
}

TEST(CutTiming, DISABLED_Zone5k) { drive("5k", ComplianceMethod::zone, 2000); }
TEST(CutTiming, DISABLED_Zone1k) { drive("1k", ComplianceMethod::zone, 2000); }
TEST(CutTiming, DISABLED_Exact1k) { drive("1k", ComplianceMethod::exact, 200); }

}  // namespace
}  // namespace hapticd
