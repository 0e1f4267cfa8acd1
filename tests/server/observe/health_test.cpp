// What the daemon tells of its health, folded.
#include "server/observe/health.h"

#include "server/observe/instrument_shape.h"

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

// A box is twelve triangles wound outward, whose area is the box's; a blade's edge is a capsule a piece.
TEST(Health, AnInstrumentsShapeHasItsConvexPartsAndItsBlade) {
  Instrument instrument;
  Primitive capsule;
  capsule.shape = Shape::capsule;
  capsule.radius = 2;
  capsule.half_length = 3;
  capsule.placement.p = {4, 5, 6};
  std::vector<Vec3> corners;
  for (const double x : {0, 1})
    for (const double y : {0, 2})
      for (const double z : {0, 3}) corners.push_back(Vec3(x, y, z));
  instrument.primitives = {capsule, make_convex("box", corners, {Vec3(7, 0, 0), Quat::Identity()})};
  instrument.blade = make_blade({Vec3(0, 0, 0), Vec3(0, 0, 4)}, Vec3(1, 0, 0), 3);
  const std::vector<float> shape = instrument_shape(instrument);
  ASSERT_EQ(shape.size(), 10u * (1 + 12 + 1));
  EXPECT_EQ(std::vector<float>(shape.begin(), shape.begin() + 10),
            (std::vector<float>{1, 2, 3, 4, 5, 6, 0, 0, 0, 1}));
  double area = 0, volume = 0;
  for (std::size_t i = 10; i < 130; i += 10) {
    EXPECT_EQ(shape[i], 3);
    const auto at = [&](std::size_t k) {
      return Vec3(shape[i + 1 + 3 * k], shape[i + 2 + 3 * k], shape[i + 3 + 3 * k]);
    };
    area += 0.5 * (at(1) - at(0)).cross(at(2) - at(0)).norm();
    volume += at(0).dot(at(1).cross(at(2))) / 6;
  }
  EXPECT_NEAR(area, 22, 1e-5);
  EXPECT_NEAR(volume, 6, 1e-5) << "outward";
  EXPECT_EQ(std::vector<float>(shape.end() - 10, shape.end()),
            (std::vector<float>{1, 0.04f, 2, 0, 0, 2, 0, 0, 0, 1}));
}

}  // namespace
}  // namespace hapticd
