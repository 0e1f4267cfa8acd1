// Samples of a blade's edge: equal parts of its length, and the width across the direction of the cut.
#include "physics/contact/cutting/blade.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

TEST(Blade, StraightEdgeIsCutIntoEqualParts) {
  const Blade blade = make_blade({Vec3(-2, 0, 1), Vec3(2, 0, 1)}, Vec3(0, 0, -3), 8);
  ASSERT_EQ(blade.sample.size(), 8u);
  EXPECT_EQ(blade.direction, -Vec3::UnitZ());
  for (int k = 0; k < 8; ++k) {
    const BladePoint& point = blade.sample[static_cast<std::size_t>(k)];
    EXPECT_LT((point.place - Vec3(-1.75 + 0.5 * k, 0, 1)).norm(), 1e-15);
    EXPECT_NEAR(point.width, 0.5, 1e-15);
    const EdgeSample e = edge_sample(blade, 2, k);
    EXPECT_EQ(e.id, edge_id(2, k));
    EXPECT_TRUE(is_edge(e.id));
    EXPECT_EQ(e.place, point.place);
    EXPECT_EQ(e.instrument, 2);
  }
}

// An advance a along d sweeps a parallelogram: half the length at 30° to the edge. A part around a corner has
// of both pieces what it holds.
TEST(Blade, WidthIsWhatAnAdvanceSweeps) {
  const Blade slanted = make_blade({Vec3(0, 0, 0), Vec3(3, 0, 0)}, Vec3(std::sqrt(3.0), 0, -1), 3);
  for (const BladePoint& point : slanted.sample) EXPECT_NEAR(point.width, 0.5, 1e-15);

  const Blade corner = make_blade({Vec3(-1, 0, 0), Vec3(0, 0, 0), Vec3(0, 0, 2)}, -Vec3::UnitZ(), 2);
  EXPECT_NEAR(corner.sample[0].width, 1, 1e-15);
  EXPECT_NEAR(corner.sample[1].width, 0, 1e-15);
  EXPECT_LT((corner.sample[0].place - Vec3(-0.25, 0, 0)).norm(), 1e-15);
  EXPECT_LT((corner.sample[1].place - Vec3(0, 0, 1.25)).norm(), 1e-15);
}

TEST(Blade, WhatIsNoEdgeIsRefused) {
  const std::vector<Vec3> edge = {Vec3::Zero(), Vec3::UnitX()};
  EXPECT_THROW(make_blade({Vec3::Zero()}, Vec3::UnitZ(), 4), std::invalid_argument);
  EXPECT_THROW(make_blade({Vec3::Zero(), Vec3::Zero()}, Vec3::UnitZ(), 4), std::invalid_argument);
  EXPECT_THROW(make_blade(edge, Vec3::Zero(), 4), std::invalid_argument);
  EXPECT_THROW(make_blade(edge, Vec3::UnitX(), 4), std::invalid_argument);
  EXPECT_THROW(make_blade(edge, Vec3::UnitZ(), 0), std::invalid_argument);
  EXPECT_THROW(make_blade(edge, Vec3::UnitZ(), max_edge_samples + 1), std::invalid_argument);
}

}  // namespace
}  // namespace hapticd
