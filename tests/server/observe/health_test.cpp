// What the daemon tells of its health, folded.
#include "server/observe/health.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

namespace hapticd {
namespace {

// The beginning of a bin, as health.h has it [ns].
double begin_of(int bin) {
  if (bin == 0) return 0;
  const int q = bin - 1;
  return std::ldexp(1.0 + 0.25 * (q % 4), 10 + q / 4);
}

TEST(Health, ABinHoldsWhatLiesInIt) {
  for (int bin = 0; bin < health_bins; ++bin) {
    const auto from = static_cast<std::int64_t>(begin_of(bin));
    const auto to =
        bin + 1 < health_bins ? static_cast<std::int64_t>(begin_of(bin + 1)) - 1 : std::int64_t{1} << 33;
    for (const std::int64_t ns : {from, (from + to) / 2, to}) {
      Histogram h;
      h.record(ns);
      const std::vector<std::uint32_t> counts = health_counts(h.snapshot());
      ASSERT_EQ(counts.size(), std::size_t{health_bins});
      EXPECT_EQ(counts[static_cast<std::size_t>(bin)], 1u) << bin << ": " << ns << " ns";
      EXPECT_EQ(std::accumulate(counts.begin(), counts.end(), 0u), 1u);
    }
  }
}

TEST(Health, AForceBlockIsTheMeanAndTheLargestOfTenTicks) {
  ForceBlocks blocks;
  for (int i = 0; i < 9; ++i) blocks.note({1, 0, 0});
  EXPECT_EQ(blocks.count(), 0u);
  blocks.note({1, 0, 10});
  EXPECT_EQ(blocks.count(), 1u);
  EXPECT_EQ(blocks.newest(), (std::vector<float>{1, 0, 1, std::sqrt(101.f)}));
}

TEST(Health, TheNewestSecondIsKeptOldestFirst) {
  ForceBlocks blocks;
  for (int b = 0; b < 130; ++b)
    for (std::size_t i = 0; i < ticks_per_block; ++i) blocks.note({double(b), 0, 0});
  const std::vector<float> newest = blocks.newest();
  ASSERT_EQ(newest.size(), 4 * blocks_kept);
  EXPECT_EQ(newest.front(), 30);
  EXPECT_EQ(newest[4 * blocks_kept - 4], 129);
  EXPECT_EQ(blocks.count(), 130u);
}

TEST(Health, ConvexMeshesAreLeftOutOfTheInstrumentsShape) {
  Instrument instrument;
  Primitive capsule;
  capsule.shape = Shape::capsule;
  capsule.radius = 2;
  capsule.half_length = 3;
  capsule.placement.p = {4, 5, 6};
  Primitive convex;
  convex.shape = Shape::convex;
  instrument.primitives = {convex, capsule};
  EXPECT_EQ(instrument_shape(instrument), (std::vector<float>{1, 2, 3, 4, 5, 6, 0, 0, 0, 1}));
}

}  // namespace
}  // namespace hapticd
