#include "physics/simulation/wide_coulomb.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

struct Case {
  MatX W;
  VecX q;
  std::vector<double> mu;
};

// Contacts on a common tissue: full rank, or sharing fewer freedoms than they have rows.
Case seeded(Random& random, int contacts, int rank) {
  Case c;
  c.W = random_psd(random, 3 * contacts, rank);
  c.q.resize(3 * contacts);
  const double size = c.W.trace() / (3 * contacts);
  for (int i = 0; i < contacts; ++i) {
    c.q.segment<3>(3 * i) =
        size * Vec3(uniform(random, -1, 0.5), uniform(random, -1, 1), uniform(random, -1, 1));
    c.mu.push_back(i % 5 == 0 ? 0 : uniform(random, 0, 1));
  }
  return c;
}

TEST(WideCoulomb, AgreesWithTheHapticSolverWhereThatHasRoom) {
  Random random(11);
  CoulombOptions options;
  options.tolerance = 1e-11;
  options.max_sweeps = 2000;
  const auto workspace = std::make_unique<CoulombWorkspace>();
  int compared = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const int n = 1 + trial % 20;
    const Case c = seeded(random, n, 6 * n);
    VecX narrow = VecX::Zero(3 * n), wide = narrow;
    const CoulombResult a = solve_coulomb(c.W, c.q, c.mu, narrow, *workspace, 0, options);
    const CoulombResult b = solve_wide_coulomb(c.W, c.q, c.mu, wide, options);
    EXPECT_LT(b.residual, 1e-8) << trial;
    EXPECT_NEAR(b.residual, coulomb_residual(c.W, c.q, wide, c.mu), 1e-6);
    if (a.residual > 1e-10 || b.residual > 1e-10) continue;
    ++compared;
    EXPECT_LT((narrow - wide).norm(), 1e-6 * (1 + narrow.norm())) << trial;
  }
  EXPECT_GT(compared, 150);
}

TEST(WideCoulomb, MoreContactsThanTheHapticSolverHolds) {
  Random random(12);
  CoulombOptions options;
  options.max_sweeps = 2000;
  int failed = 0;
  for (int trial = 0; trial < 20; ++trial) {
    const Case c = seeded(random, 120, 480);
    VecX lambda = VecX::Zero(c.q.size());
    const CoulombResult r = solve_wide_coulomb(c.W, c.q, c.mu, lambda, options);
    failed += r.status != SolveStatus::solved;
    for (int i = 0; i < 120; ++i) {
      EXPECT_GE(lambda[3 * i], 0);
      EXPECT_LE(lambda.segment<2>(3 * i + 1).norm(), c.mu[i] * lambda[3 * i] * (1 + 1e-9) + 1e-12);
    }
  }
  EXPECT_EQ(failed, 0);
}

// Tangents that W does not move, as of an instrument without friction among bodies with it.
TEST(WideCoulomb, FrictionlessContactsAmongOthersMayLeaveTheirTangentsOut) {
  Random random(13);
  for (int trial = 0; trial < 50; ++trial) {
    Case c = seeded(random, 10, 60), full = c;
    for (int i = 0; i < 10; i += 5)
      for (int t = 1; t < 3; ++t) {
        c.W.row(3 * i + t).setZero();
        c.W.col(3 * i + t).setZero();
        c.q[3 * i + t] = 0;
      }
    VecX a = VecX::Zero(30), b = a;
    CoulombOptions options;
    options.tolerance = 1e-11;
    options.max_sweeps = 2000;
    solve_wide_coulomb(c.W, c.q, c.mu, a, options);
    solve_wide_coulomb(full.W, full.q, full.mu, b, options);
    EXPECT_LT((a - b).norm(), 1e-7 * (1 + b.norm()));
  }
}

TEST(WideCoulomb, WhatIsNotFiniteGivesZero) {
  VecX lambda = VecX::Ones(3);
  const VecX q = VecX::Constant(3, std::numeric_limits<double>::quiet_NaN());
  const std::vector<double> mu = {0.3};
  EXPECT_EQ(solve_wide_coulomb(MatX::Identity(3, 3), q, mu, lambda, {}).status, SolveStatus::not_finite);
  EXPECT_TRUE(lambda.isZero(0));
}

}  // namespace
}  // namespace hapticd
