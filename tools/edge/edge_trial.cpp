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

void compare(const std::vector<OfflineTick>& as_it_is, const std::vector<OfflineTick>& carried,
             EdgeTrial& trial) {
  double squares = 0, largest = 0, peak = 0;
  const std::size_t ticks = std::min(as_it_is.size(), carried.size());
  for (std::size_t k = 0; k < ticks; ++k) {
    const double error = (carried[k].wrench - as_it_is[k].wrench).head<3>().norm();
    squares += error * error;
    largest = std::max(largest, error);
    peak = std::max(peak, as_it_is[k].wrench.head<3>().norm());
  }
  if (ticks == 0 || peak == 0) return;
  const double rms = std::sqrt(squares / static_cast<double>(ticks)) / peak;
  if (trial.force_peak > 0 && rms <= trial.force_rms_rel) return;
  trial.force_rms_rel = rms;
  trial.force_max_rel = largest / peak;
  trial.force_peak = peak;
}

}  // namespace

EdgeTrial try_edge(const Scene& scene, double seconds) {
  OfflineInput input = along_trajectories(scene, "the scene is tried along it");
  if (seconds > 0) input.to = std::min(input.to, input.from + seconds);
  EdgeTrial trial;
  trial.seconds = input.to - input.from;
  trial.rate = scene.rate;
  Progress progress("edge trial");
  const auto part = [&progress](double from, const char* what) -> OfflineProgress {
    return [&progress, from, what](double fraction) {
      progress.show(from + fraction / 2, what);
      return true;
    };
  };
  input.removals = record_removals(scene, input, {});
  const OfflineResult as_it_is = run_offline(scene, input, {}, part(0, "as it is"));
  Traffic traffic(static_cast<int>(scene.instruments.size()));
  OfflineOptions through;
  through.carried = [&traffic](CondensedProblem& problem) { traffic.carry(problem); };
  const OfflineResult carried = run_offline(scene, input, through, part(0.5, "as it would arrive"));
  for (std::size_t i = 0; i < scene.instruments.size(); ++i)
    compare(as_it_is.hands[static_cast<int>(i)], carried.hands[static_cast<int>(i)], trial);
  traffic.report(trial.seconds + input.settle, scene.rate, trial);
  return trial;
}

}  // namespace hapticd
