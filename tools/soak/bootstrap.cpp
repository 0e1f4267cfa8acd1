#include "tools/soak/bootstrap.h"

#include <algorithm>
#include <random>

namespace hapticd {
namespace {

constexpr int draws = 400;
constexpr double left_out = 0.05;  // at either end

// Slices as counts over the values that any of them has.
class Slices {
 public:
  explicit Slices(const std::vector<Tally>& slices) {
    Tally all;
    for (const Tally& s : slices) all.merge(s);
    for (const auto& [value, n] : all.bins()) values_.push_back(value);
    for (const Tally& s : slices) {
      std::vector<std::uint64_t> counts(values_.size());
      for (const auto& [value, n] : s.bins())
        counts[std::lower_bound(values_.begin(), values_.end(), value) - values_.begin()] = n;
      counts_.push_back(std::move(counts));
    }
  }

  double drawn_percentile(std::mt19937_64& random, double percent) const {
    std::vector<std::uint64_t> sum(values_.size());
    for (std::size_t i = 0; i < counts_.size(); ++i) {
      const auto& drawn = counts_[random() % counts_.size()];
      for (std::size_t v = 0; v < sum.size(); ++v) sum[v] += drawn[v];
    }
    Tally tally;
    for (std::size_t v = 0; v < sum.size(); ++v) tally.add(values_[v], sum[v]);
    return tally.percentile(percent);
  }

 private:
  std::vector<double> values_;
  std::vector<std::vector<std::uint64_t>> counts_;  // slice, value
};

}  // namespace

std::optional<Interval> bootstrap_ratio(const std::vector<Tally>& ours, const std::vector<Tally>& theirs,
                                        double percent) {
  if (ours.size() < 2 || theirs.size() < 2) return std::nullopt;
  const Slices a(ours), b(theirs);
  std::mt19937_64 random(1);
  std::vector<double> ratios;
  for (int i = 0; i < draws; ++i) {
    const double over = a.drawn_percentile(random, percent), under = b.drawn_percentile(random, percent);
    if (under > 0) ratios.push_back(over / under);
  }
  if (ratios.empty()) return std::nullopt;
  std::sort(ratios.begin(), ratios.end());
  const auto at = [&](double share) {
    return ratios[static_cast<std::size_t>(share * static_cast<double>(ratios.size() - 1))];
  };
  return Interval{at(left_out), at(1 - left_out)};
}

}  // namespace hapticd
