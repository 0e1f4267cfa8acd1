#include "haptic/histogram.h"

#include <random>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

// Nearest rank on the sorted data: the definition.
std::int64_t percentile_of(const std::vector<std::int64_t>& sorted, double p) {
  const double wanted = std::ceil(p / 100 * double(sorted.size()) - 1e-9);
  const auto rank = static_cast<std::size_t>(std::max(1.0, wanted));
  return sorted[rank - 1];
}

TEST(Histogram, EveryDurationFallsIntoABinNarrowerThanTwoPercent) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> exponent(std::log(100.0), std::log(1e10));
  for (int i = 0; i < 200'000; ++i) {
    const auto ns = static_cast<std::int64_t>(std::exp(exponent(random)));
    const double centre = histogram_centre(histogram_bin(ns));
    ASSERT_NEAR(centre / static_cast<double>(ns), 1.0, 0.0082) << ns;
  }
}

TEST(Histogram, BinsAreConsecutiveAndNeverFallBack) {
  int last = histogram_bin(0);
  for (std::int64_t ns = 1; ns < 100'000; ++ns) {
    const int bin = histogram_bin(ns);
    ASSERT_TRUE(bin == last || bin == last + 1) << ns;
    last = bin;
  }
  EXPECT_EQ(histogram_bin(INT64_MAX), histogram_bins - 1);
  EXPECT_EQ(histogram_bin(-5), 0);
}

TEST(Histogram, PercentilesAgreeWithSortedData) {
  std::mt19937_64 random(7);
  std::lognormal_distribution<double> body(std::log(30e3), 1.2);
  Histogram histogram;
  std::vector<std::int64_t> data;
  for (int i = 0; i < 50'000; ++i) {
    const auto ns = static_cast<std::int64_t>(body(random)) + (i % 1000 == 0 ? 10'000'000 : 0);
    data.push_back(ns);
    histogram.record(ns);
  }
  std::sort(data.begin(), data.end());
  const HistogramSnapshot s = histogram.snapshot();
  for (double p : {0.0, 0.1, 10.0, 50.0, 90.0, 99.0, 99.9, 99.99}) {
    const auto exact = static_cast<double>(percentile_of(data, p));
    EXPECT_NEAR(s.percentile(p), exact, 0.0082 * exact + 1) << p;
  }
  EXPECT_EQ(s.percentile(100), static_cast<double>(data.back()));
  EXPECT_EQ(s.min, data.front());
  EXPECT_EQ(s.max, data.back());
  EXPECT_EQ(s.count, data.size());
  double sum = 0;
  for (std::int64_t ns : data) sum += static_cast<double>(ns);
  EXPECT_NEAR(s.mean(), sum / double(data.size()), 1e-6 * s.mean());
}

TEST(Histogram, MergeIsTheHistogramOfBoth) {
  std::mt19937_64 random(3);
  std::uniform_int_distribution<std::int64_t> any(0, 50'000'000);
  Histogram a, b, both;
  for (int i = 0; i < 5000; ++i) {
    const std::int64_t ns = any(random);
    (i % 3 ? a : b).record(ns);
    both.record(ns);
  }
  HistogramSnapshot merged;
  merged.merge(HistogramSnapshot{});
  merged.merge(a.snapshot());
  merged.merge(b.snapshot());
  const HistogramSnapshot expected = both.snapshot();
  EXPECT_EQ(merged.bin, expected.bin);
  EXPECT_EQ(merged.count, expected.count);
  EXPECT_EQ(merged.min, expected.min);
  EXPECT_EQ(merged.max, expected.max);
  EXPECT_EQ(merged.sum, expected.sum);
}

TEST(Histogram, EmptyHasNoPercentile) {
  const HistogramSnapshot s = Histogram{}.snapshot();
  EXPECT_EQ(s.percentile(50), 0);
  EXPECT_EQ(s.mean(), 0);
  EXPECT_EQ(s.max, 0);
}

TEST(Histogram, SnapshotsTakenMeanwhileOnlyGrow) {
  Histogram histogram;
  std::thread writer([&] {
    for (int i = 0; i < 200'000; ++i) histogram.record(i);
  });
  std::uint64_t last = 0;
  for (int i = 0; i < 50; ++i) {
    const HistogramSnapshot s = histogram.snapshot();
    EXPECT_GE(s.count, last);
    last = s.count;
  }
  writer.join();
  EXPECT_EQ(histogram.snapshot().count, 200'000u);
}

}  // namespace
}  // namespace hapticd
