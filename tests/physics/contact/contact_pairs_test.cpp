// Which primitives a sample is held by: all in reach, but those whose rows another's imply.
#include "physics/contact/contact_pairs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "physics/contact/rows.h"
#include "tests/support/contact_loop.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

Instrument balls(const std::vector<std::pair<double, double>>& place_and_radius) {
  Instrument instrument;
  for (const auto& [x, radius] : place_and_radius) {
    instrument.primitives.push_back(sphere_instrument(radius).primitives[0]);
    instrument.primitives.back().placement.p = Vec3(x, 0, 0);
  }
  return instrument;
}

std::vector<int> in_reach(const Instrument& instrument, const Vec3& x, double reach) {
  std::vector<int> primitives;
  for (const Gap& gap : GapsInReach(PlacedInstrument(instrument, Pose{}), x, reach)) {
    EXPECT_LT(gap.distance, reach);
    primitives.push_back(gap.primitive);
  }
  return primitives;
}

TEST(ContactPairs, AllInReachByPrimitive) {
  const Instrument two = balls({{-1e-3, 0.5e-3}, {1e-3, 0.7e-3}});
  EXPECT_EQ(in_reach(two, Vec3::Zero(), 0.6e-3), (std::vector<int>{0, 1}));
  EXPECT_EQ(in_reach(two, Vec3::Zero(), 0.4e-3), (std::vector<int>{1}));
  EXPECT_EQ(in_reach(two, Vec3::Zero(), 0.2e-3), (std::vector<int>{}));
}

// Balls about one centre have one normal: the largest implies the others, and of equal ones the first is
// taken.
TEST(ContactPairs, EqualNormalsAreOnePair) {
  const Vec3 x(0.1e-3, 0.3e-3, 0.6e-3);
  EXPECT_EQ(in_reach(balls({{0, 0.4e-3}, {0, 0.5e-3}, {0, 0.45e-3}}), x, 1e-3), (std::vector<int>{1}));
  EXPECT_EQ(in_reach(balls({{0, 0.5e-3}, {0, 0.5e-3}}), x, 1e-3), (std::vector<int>{0}));
}

TEST(ContactPairs, NoMoreThanTheNearest) {
  std::vector<std::pair<double, double>> many;
  for (int k = 0; k < 12; ++k) many.emplace_back(1e-3 + 0.1e-3 * k, 0.5e-3);
  EXPECT_EQ(in_reach(balls(many), Vec3(0, 0.1e-3, 0), 1), (std::vector<int>{0, 1, 2, 3, 4, 5, 6, 7}));
  std::reverse(many.begin(), many.end());
  EXPECT_EQ(in_reach(balls(many), Vec3(0, 0.1e-3, 0), 1), (std::vector<int>{4, 5, 6, 7, 8, 9, 10, 11}));
}

// A needle's round end within its tip adds no row and changes no bit.
TEST(ContactPairs, APartWithinAnotherChangesNothing) {
  Random random(5);
  SheetSettings settings;
  settings.friction = 0.3;
  const auto problem = sheet_problem(random, settings);
  const Instrument one = balls({{0, 2e-3}}), two = balls({{0, 2e-3}, {0, 1.95e-3}});
  ContactLoop alone, both;
  for (int tick = 0; tick < 60; ++tick) {
    const Pose X{Vec3(0.3e-3 + 2e-6 * tick, 0.1e-3, 2e-3 - 10e-6 * tick), Quat::Identity()};
    const ContactSolution a = alone.solve(*problem, one, X), b = both.solve(*problem, two, X);
    EXPECT_EQ(a.contacts, b.contacts);
    EXPECT_EQ(a.wrench[0], b.wrench[0]);
    EXPECT_EQ(a.lost, b.lost);
  }
}

// Three balls over a fine sheet make more pairs than rows: as many rows as there may be, each pair once, in
// order.
TEST(ContactPairs, CapacityHolds) {
  Random random(6);
  SheetSettings settings;
  settings.nodes = 9;
  settings.per_triangle = 4;
  const auto problem = sheet_problem(random, settings);
  ASSERT_EQ(problem->samples, max_patch_samples);
  const Instrument three = balls({{-1e-3, 30e-3}, {0, 30e-3}, {1e-3, 30e-3}});
  const Pose X{Vec3(0, 0, 29e-3), Quat::Identity()};
  const auto rows = std::make_unique<ContactRows>();
  build_rows(*problem, three, X, X, problem->x_free, Vec6(Vec6::Constant(1e-3)), ContactMemory{}, 5e-3, *rows);
  EXPECT_EQ(rows->contacts, max_contacts);
  int overlapping = 0;
  for (int k = 0; k < problem->samples; ++k)
    for (const Gap& gap :
         GapsInReach(PlacedInstrument(three, X), sample_position(*problem, problem->x_free, k), 0))
      overlapping += gap.distance < 0;
  EXPECT_GT(overlapping, max_patch_samples);
  int held = 0;
  for (int i = 0; i < rows->contacts; ++i) {
    const ContactRow& row = rows->row[i];
    held += row.gap < 0;
    if (i == 0) continue;
    const ContactRow& before = rows->row[i - 1];
    EXPECT_TRUE(before.sample < row.sample ||
                (before.sample == row.sample && before.primitive < row.primitive));
  }
  EXPECT_EQ(rows->dropped, overlapping - held);
}

}  // namespace
}  // namespace hapticd
