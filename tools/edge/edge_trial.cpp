#include "tools/edge/edge_trial.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "server/edge/edge_problem.h"
#include "tools/cli/progress.h"
#include "tools/offline/offline_run.h"

namespace hapticd {
namespace {

constexpr int nodes_per_row = 20;

// What was carried, by time and by size of the patch.
class Traffic {
 public:
  Traffic(int instruments) : instruments_(instruments), read_(std::make_unique<CondensedProblem>()) {}

  void carry(CondensedProblem& problem) {
    const hapticd_msg_EdgeProblem& message = packed_.pack(problem, instruments_);
    const auto bytes = static_cast<double>(packed_.bytes());
    Row& row = rows_[problem.nodes / nodes_per_row];
    ++row.problems;
    row.bytes += bytes;
    row.samples_max = std::max(row.samples_max, problem.samples);
    ++problems_;
    bytes_ += bytes;
    by_second_[problem.published_ns / 1'000'000'000] += bytes;
    if (read_problem(message, instruments_, *read_) == ProblemFault::none)
      copy_in_use(*read_, problem);
    else
      ++refused_;
  }

  void report(double seconds, double rate, EdgeTrial& trial) const {
    trial.problems = problems_;
    trial.refused = refused_;
    trial.mbit = 8e-6 * bytes_ / seconds;
    trial.mbit_steps = problems_ > 0 ? 8e-6 * rate * bytes_ / static_cast<double>(problems_) : 0;
    for (const auto& [second, bytes] : by_second_) trial.mbit_peak = std::max(trial.mbit_peak, 8e-6 * bytes);
    for (const auto& [k, row] : rows_) {
      const double mean = row.bytes / static_cast<double>(row.problems);
      trial.patches.push_back({k * nodes_per_row, (k + 1) * nodes_per_row - 1, row.problems, mean,
                               8e-6 * rate * mean, row.samples_max});
    }
  }

 private:
  struct Row {
    std::size_t problems = 0;
    double bytes = 0;
    int samples_max = 0;
  };
  const int instruments_;
  PackedProblem packed_;
  std::unique_ptr<CondensedProblem> read_;
  std::size_t problems_ = 0, refused_ = 0;
  double bytes_ = 0;
  std::map<std::int64_t, double> by_second_;
  std::map<int, Row> rows_;
};

struct ForceDifference {
  double rms_rel = 0, max_rel = 0, peak = 0;
};

ForceDifference difference_of(const std::vector<OfflineTick>& as_it_is,
                              const std::vector<OfflineTick>& carried) {
  double squares = 0, largest = 0, peak = 0;
  const std::size_t ticks = std::min(as_it_is.size(), carried.size());
  for (std::size_t k = 0; k < ticks; ++k) {
    const double error = (carried[k].wrench - as_it_is[k].wrench).head<3>().norm();
    squares += error * error;
    largest = std::max(largest, error);
    peak = std::max(peak, as_it_is[k].wrench.head<3>().norm());
  }
  if (ticks == 0 || peak == 0) return {};
  return {std::sqrt(squares / static_cast<double>(ticks)) / peak, largest / peak, peak};
}

// Of the hand that is worst off.
ForceDifference worst(const Scene& scene, const OfflineResult& as_it_is, const OfflineResult& carried) {
  ForceDifference all;
  for (int i = 0; i < static_cast<int>(scene.instruments.size()); ++i) {
    const ForceDifference of = difference_of(as_it_is.hands[i], carried.hands[i]);
    if (all.peak == 0 || of.rms_rel > all.rms_rel) all = of;
  }
  return all;
}

}  // namespace

EdgeTrial try_edge(const Scene& scene, double seconds) {
  OfflineInput input = along_trajectories(scene, "the scene is tried along it");
  if (seconds > 0) input.to = std::min(input.to, input.from + seconds);
  EdgeTrial trial;
  trial.seconds = input.to - input.from;
  trial.rate = scene.rate;
  Progress progress("edge trial");
  constexpr double runs = 2 + 2 * std::size(tried_links);
  const auto part = [&progress](double run, const char* what) -> OfflineProgress {
    return [&progress, run, what](double fraction) {
      progress.show((run + fraction) / runs, what);
      return true;
    };
  };
  input.removals = record_removals(scene, input, {});
  const OfflineResult as_it_is = run_offline(scene, input, {}, part(0, "as it is"));
  Traffic traffic(static_cast<int>(scene.instruments.size()));
  OfflineOptions through;
  through.carried = [&traffic](CondensedProblem& problem) { traffic.carry(problem); };
  const OfflineResult carried = run_offline(scene, input, through, part(1, "as it would arrive"));
  const ForceDifference packing = worst(scene, as_it_is, carried);
  trial.force_rms_rel = packing.rms_rel;
  trial.force_max_rel = packing.max_rel;
  trial.force_peak = packing.peak;
  double run = 2;
  for (const LinkTrouble& link : tried_links) {
    LinkCost cost{.link = link};
    for (const bool tank : {false, true}) {
      OfflineOptions late;
      late.link = link;
      late.passivity_control = tank;
      const OfflineResult there = run_offline(scene, input, late, part(run++, "over a link"));
      (tank ? cost.tanked_rms_rel : cost.force_rms_rel) = worst(scene, as_it_is, there).rms_rel;
    }
    trial.links.push_back(cost);
  }
  traffic.report(trial.seconds + input.settle, scene.rate, trial);
  return trial;
}

}  // namespace hapticd
