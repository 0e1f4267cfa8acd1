// Counts of values, for percentiles over many slices of a run.
//
// A value is kept as given (the daemon's histograms are sums of bin centres, cyclictest's of whole
// microseconds), so two tallies are merged or subtracted without loss. Percentiles by nearest rank.
#pragma once

#include <cmath>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>

namespace hapticd {

class Tally {
 public:
  void add(double value, std::uint64_t n = 1) {
    if (n == 0) return;
    bins_[value] += n;
    count_ += n;
  }
  void merge(const Tally& other) {
    for (const auto& [value, n] : other.bins_) add(value, n);
  }
  // What came since `before`, an earlier state of the same histogram.
  Tally since(const Tally& before) const {
    Tally result;
    for (const auto& [value, n] : bins_) {
      const auto old = before.bins_.find(value);
      result.add(value, n - (old == before.bins_.end() ? 0 : old->second));
    }
    return result;
  }

  std::uint64_t count() const { return count_; }
  double max() const { return count_ ? bins_.rbegin()->first : 0; }
  double percentile(double p) const {
    const double wanted = std::ceil(p / 100 * static_cast<double>(count_) - 1e-9);
    std::uint64_t below = 0;
    for (const auto& [value, n] : bins_)
      if (static_cast<double>(below += n) >= wanted) return value;
    return 0;
  }
  const std::map<double, std::uint64_t>& bins() const { return bins_; }

 private:
  std::map<double, std::uint64_t> bins_;
  std::uint64_t count_ = 0;
};

// {"p50", "p99", "p99_9", "max", "count"}; null without values.
nlohmann::ordered_json to_json(const Tally& tally);

// [[value, count], …] as the daemon writes its histograms.
Tally tally_from(const nlohmann::json& bins);
nlohmann::json to_bins(const Tally& tally);

}  // namespace hapticd
