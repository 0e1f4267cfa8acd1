// Which samples have rows after a solve at the same linearisation: what it let through comes in.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "physics/contact/missed_contact.h"
#include "physics/contact/rows.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

// A sphere of 2 mm over a sheet of 8 mm.
struct SphereOnSheet {
  std::unique_ptr<CondensedProblem> problem;
  Instrument instrument = sphere_instrument(2e-3);
  Pose X;
  std::unique_ptr<ContactRows> rows = std::make_unique<ContactRows>();

  SphereOnSheet(std::uint64_t seed, int nodes, double height) {
    Random random(seed);
    SheetSettings settings;
    settings.nodes = nodes;
    settings.friction = 0.3;
    problem = sheet_problem(random, settings);
    problem->alarm_distance = 4e-3;
    X.p = Vec3(uniform(random, -1e-3, 1e-3), uniform(random, -1e-3, 1e-3), height);
  }
  // Samples that have rows, where those within the margin have and, after a solve, what it let through.
  std::vector<int> build(double margin, const Reached* end = nullptr) {
    build_rows(*problem, instrument, X, X, problem->x_free, Vec6(Vec6::Constant(1e-3)), ContactMemory{},
               margin, *rows, end);
    std::vector<int> sample;
    for (int i = 0; i < rows->contacts; ++i) sample.push_back(rows->row[i].sample);
    return sample;
  }
  // Where a solve has taken the sheet: its nodes on one side of the instrument up by so much, the others
  // down.
  PatchPositions tilted(double right, double up) const {
    PatchPositions x = problem->x_free;
    for (int n = 0; n < problem->nodes; ++n) x[n].z() += (x[n].x() - X.p.x()) * right > 0 ? up : -up;
    return x;
  }
};

// Two solves that let through what the other had held: the rows of both, and of what was near at first.
TEST(ReachedRows, WhatHasARowKeepsIt) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SphereOnSheet s(seed, 5, 1.6e-3);
    const PatchPositions right = s.tilted(1, 1e-3), left = s.tilted(-1, 1e-3);
    const Reached first{right, s.X}, second{left, s.X};
    const auto near = s.build(0.05e-3), one = s.build(0.05e-3, &first), both = s.build(0.05e-3, &second);
    ASSERT_GT(one.size(), near.size()) << seed;
    ASSERT_GT(both.size(), one.size());
    ASSERT_LT(static_cast<int>(both.size()), max_contacts);
    EXPECT_TRUE(std::includes(both.begin(), both.end(), one.begin(), one.end()));
    EXPECT_TRUE(std::includes(one.begin(), one.end(), near.begin(), near.end()));
  }
}

// More within the margin than fit: those that the solve lets through are all there.
TEST(ReachedRows, WhereNotAllFitWhatStaysOpenGoes) {
  SphereOnSheet s(4, 12, 2.3e-3);  // clear of the sheet
  const PatchPositions x = s.tilted(1, 0.6e-3);
  const Reached end{x, s.X};
  ASSERT_EQ(static_cast<int>(s.build(3e-3).size()), max_contacts);
  const auto rows = s.build(3e-3, &end);
  int through = 0;
  for (int k = 0; k < s.problem->samples; ++k) {
    const Vec3 at = sample_position(*s.problem, s.problem->x_free, k);
    const double gap = gap_reached(*s.problem, k, at, gap_at(s.instrument, s.X, at), s.X, Vec6::Zero(), x);
    if (!(gap < 0)) continue;
    ++through;
    EXPECT_TRUE(std::binary_search(rows.begin(), rows.end(), k)) << k;
  }
  EXPECT_GT(through, 20);
  EXPECT_EQ(rows.size(), static_cast<std::size_t>(through)) << "the others stay open";
}

// A solve that throws tissue lets many through: the deepest come in, the others where they still are.
TEST(ReachedRows, AFewComeInAtATime) {
  SphereOnSheet s(4, 12, 2.3e-3);
  const PatchPositions x = s.tilted(1, 0.6e-3);
  const Reached end{x, s.X, 24};
  ASSERT_TRUE(s.build(0.05e-3).empty());
  std::vector<std::size_t> sizes;
  std::vector<int> before;
  while (sizes.size() < 2 || sizes.back() > sizes[sizes.size() - 2]) {
    const auto rows = s.build(0.05e-3, &end);
    EXPECT_TRUE(std::includes(rows.begin(), rows.end(), before.begin(), before.end()));
    if (sizes.empty()) {
      double deepest = 0;
      int at = -1;
      for (int k = 0; k < s.problem->samples; ++k) {
        const Vec3 from = sample_position(*s.problem, s.problem->x_free, k);
        const double gap =
            gap_reached(*s.problem, k, from, gap_at(s.instrument, s.X, from), s.X, Vec6::Zero(), x);
        if (gap >= deepest) continue;
        deepest = gap;
        at = k;
      }
      EXPECT_TRUE(std::binary_search(rows.begin(), rows.end(), at));
    }
    sizes.push_back(rows.size());
    before = rows;
  }
  ASSERT_GE(sizes.size(), 3u);
  EXPECT_EQ(sizes[0], 24u);
  EXPECT_GT(sizes.back(), 30u);
  EXPECT_LT(static_cast<int>(sizes.back()), max_contacts) << "all that it lets through";

  SphereOnSheet other(4, 12, 2.3e-3);
  const Reached all{x, other.X};
  ASSERT_TRUE(other.build(0.05e-3).empty());
  EXPECT_EQ(other.build(0.05e-3, &all).size(), sizes.back()) << "at once, where nobody asks for few";
}

}  // namespace
}  // namespace hapticd
