// The published overlap is that of all samples, not of those that are rows.
#include <gtest/gtest.h>

#include "tests/support/contact_loop.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

// A ball of 2 mm comes from below: the sample's normal says that this is the tissue's inner side, so it is no
// row, and it is 1.5 mm inside the ball.
TEST(Penetration, CountsSamplesThatAreNoRows) {
  auto problem = spring_problem(100, Vec3::Zero(), 0);
  problem->alarm_distance = 3e-3;
  const Instrument ball = sphere_instrument(2e-3);
  Pose X;
  X.p = Vec3(0, 0, -0.5e-3);
  ContactLoop loop;
  const ContactSolution solution = loop.solve(*problem, ball, X);
  EXPECT_EQ(solution.contacts, 0);
  EXPECT_EQ(solution.wrench[0].norm(), 0);
  EXPECT_NEAR(solution.penetration, 1.5e-3, 1e-12);
  EXPECT_NEAR(solution.lost, 1.5e-3, 1e-12);
}

// A thin flap turns over within a step: published facing down, it is now free to lie facing up, each of its
// three nodes on a spring k. A ball presses it by d at its centroid, whose compliance is 1/3k:
//   force = 3 k d,   no overlap.
// By its published normal the ball is on its inner side, and it is let through.
TEST(Penetration, AFaceThatHasTurnedSinceItsProblemWasMadeIsHeld) {
  constexpr double k = 30, r = 0.5e-3, d = 20e-6;
  auto problem = std::make_unique<CondensedProblem>();
  problem->step = 1;
  problem->alarm_distance = 0.8e-3;
  problem->nodes = 3;
  const Vec3 corner[] = {{-1e-3, -1e-3, 0}, {1e-3, -1e-3, 0}, {0, 2e-3, 0}};
  for (int n = 0; n < 3; ++n) {
    problem->x_free[n] = corner[n];
    problem->x_now[n] = Vec3(corner[n].x(), -corner[n].y(), 0);  // half a turn about x
  }
  problem->C() = MatX::Identity(9, 9) / k;
  problem->samples = 1;
  problem->sample[0] = {.id = 1,
                        .node = {0, 1, 2},
                        .weight = {1. / 3, 1. / 3, 1. / 3},
                        .free = Vec3::Zero(),
                        .outward = -Vec3::UnitZ(),
                        .friction = 0};
  ContactLoop loop;
  for (int tick = 0; tick < 3; ++tick) {
    const ContactSolution solution =
        loop.solve(*problem, sphere_instrument(r), {Vec3(0, 0, r - d), Quat::Identity()});
    EXPECT_NEAR(solution.wrench[0][2], 3 * k * d, 1e-9);
    EXPECT_LT(solution.penetration, 1e-12);
  }
}

// The deadline of a clock that says 1200 ns are left, once, and then 50: a solve keeps a twelfth of the 1200
// for its end, and has nothing else. Its friction is anything, but no row that presses is inside.
TEST(Penetration, WhatEndsUnsolvedIsSolvedAlongItsNormals) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Random random(seed);
    SheetSettings sheet;
    sheet.friction = 0.4;
    const auto problem = sheet_problem(random, sheet);
    problem->alarm_distance = 0.8e-3;
    int asked = 0;
    ContactLoop loop;
    loop.options.linearisations = 1;
    loop.options.whole_W = true;
    loop.options.usable_residual = 1e-3;
    loop.options.deadline.clock = &asked;
    loop.options.deadline.left_ns = [](const void* clock) noexcept -> std::int64_t {
      return ++*static_cast<int*>(const_cast<void*>(clock)) == 1 ? 1200 : 50;
    };
    const ContactSolution solution =
        loop.solve(*problem, sphere_instrument(3e-3), {Vec3(0, 0, 2.5e-3), Quat::Identity()});
    EXPECT_EQ(solution.status, SolveStatus::deadline) << seed;
    ASSERT_GT(solution.contacts, 4) << seed;
    const ContactRows& rows = loop.scratch->rows;
    const Eigen::Map<const VecX> lambda(loop.scratch->lambda.data(), rows.rows());
    const VecX delta = rows.W() * lambda + rows.q();
    for (int i = 0; i < rows.contacts; ++i) EXPECT_GE(delta[3 * i], -1e-9) << seed;
  }
}

}  // namespace
}  // namespace hapticd
