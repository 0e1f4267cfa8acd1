// `solved` is true of what is returned: seeded families on which solvers like to be wrong, judged by a
// natural map in long double that knows nothing of them. What is no number is said to be none.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>

#include "physics/contact/solver/coulomb.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

using Wide = long double;
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// De Saxcé's natural map, relative, of (W + ε D) λ + q.
double residual_of(const MatX& W, const VecX& q, const VecX& lambda, const std::vector<double>& mu,
                   double epsilon) {
  Wide worst = 0, scale = 0;
  for (std::size_t c = 0; c < mu.size(); ++c) {
    const auto i = static_cast<Eigen::Index>(3 * c);
    const Wide D = (Wide(W(i, i)) + W(i + 1, i + 1) + W(i + 2, i + 2)) / 3;
    Wide d[3], v[3];
    for (int k = 0; k < 3; ++k) {
      d[k] = q[i + k] + epsilon * D * lambda[i + k];
      for (Eigen::Index j = 0; j < q.size(); ++j) d[k] += Wide(W(i + k, j)) * lambda[j];
    }
    v[0] = lambda[i] - (d[0] + mu[c] * std::hypot(d[1], d[2])) / D;
    for (int k = 1; k < 3; ++k) v[k] = lambda[i + k] - d[k] / D;
    const Wide t = std::hypot(v[1], v[2]);
    if (mu[c] * t <= -v[0]) {
      v[0] = v[1] = v[2] = 0;
    } else if (t > mu[c] * v[0]) {
      const Wide n = (v[0] + mu[c] * t) / (1 + Wide(mu[c]) * mu[c]), of = mu[c] * n / t;
      v[0] = n;
      v[1] *= of;
      v[2] *= of;
    }
    Wide off = 0, l = 0, free = 0;
    for (int k = 0; k < 3; ++k) {
      off += (lambda[i + k] - v[k]) * (lambda[i + k] - v[k]);
      l += Wide(lambda[i + k]) * lambda[i + k];
      free += q[i + k] / D * (q[i + k] / D);
    }
    worst = std::max(worst, off);
    scale = std::max({scale, l, free});
  }
  return scale > 0 ? static_cast<double>(std::sqrt(worst / scale)) : 0;
}

double residual_of(const MatX& W, const VecX& q, const VecX& z) {
  constexpr double epsilon = LcpOptions{}.relative_diagonal;
  Wide worst = 0, scale = 0;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    Wide w = q[i];
    for (Eigen::Index j = 0; j < q.size(); ++j) w += Wide(W(i, j)) * z[j];
    const Wide D = std::max<Wide>(W(i, i), 1e-12 * W.diagonal().maxCoeff());
    w += epsilon * D * z[i];
    worst = std::max(worst, std::abs(std::min<Wide>(z[i], w / D)));
    scale = std::max({scale, Wide(z[i]), std::abs(Wide(q[i])) / D});
  }
  return scale > 0 ? static_cast<double>(worst / scale) : 0;
}

// Each contact's compliance scaled by a random power of ten, so that they are up to `apart` from one another.
MatX badly_scaled(Random& random, int rows, int block, double apart) {
  MatX W = random_psd(random, rows, rows);
  for (int i = 0; i < rows; i += block) {
    const double s = std::sqrt(std::pow(apart, uniform(random, 0, 1)));
    W.middleRows(i, block) *= s;
    W.middleCols(i, block) *= s;
  }
  return W;
}

class Apart : public testing::TestWithParam<double> {};

TEST_P(Apart, FrictionThatIsSolvedIsSolved) {
  Random random(21);
  const auto workspace = std::make_unique<CoulombWorkspace>();
  int wrong = 0, solved = 0, lied = 0;
  double worst = 0;
  constexpr int problems = 4000;
  for (int trial = 0; trial < problems; ++trial) {
    const int n = 1 + trial % 8;
    const MatX W = badly_scaled(random, 3 * n, 3, GetParam());
    VecX q(3 * n), lambda = VecX::Zero(3 * n);
    std::vector<double> mu(n);
    for (int i = 0; i < n; ++i) {
      const double size = W.block<3, 3>(3 * i, 3 * i).trace() / 3;
      for (int k = 0; k < 3; ++k) q[3 * i + k] = size * uniform(random, -1, 0.3);
      mu[i] = uniform(random, 0, 1.5);
    }
    const CoulombResult r = solve_coulomb(W, q, mu, lambda, *workspace, 0, {});
    solved += r.status == SolveStatus::solved;
    // Of a raised diagonal the anchor is not known here.
    if (r.relative_diagonal > CoulombOptions{}.relative_diagonal) continue;
    const double truly = residual_of(W, q, lambda, mu, r.relative_diagonal);
    lied += std::abs(truly - r.residual) > 1e-8 + 0.5 * truly;
    if (r.status != SolveStatus::solved) continue;
    wrong += truly > 10 * CoulombOptions{}.tolerance;
    worst = std::max(worst, truly);
  }
  EXPECT_EQ(wrong, 0) << "worst " << worst;
  EXPECT_EQ(lied, 0);
  EXPECT_GT(solved, 0.98 * problems);
}

TEST_P(Apart, NormalsThatAreSolvedAreSolved) {
  Random random(22);
  const auto workspace = std::make_unique<LcpWorkspace>();
  int wrong = 0, solved = 0;
  constexpr int problems = 4000;
  for (int trial = 0; trial < problems; ++trial) {
    const int n = 1 + trial % 24;
    const MatX W = badly_scaled(random, n, 1, GetParam());
    VecX q(n), z = VecX::Zero(n);
    for (int i = 0; i < n; ++i) q[i] = W(i, i) * uniform(random, -1, 0.3);
    std::vector<std::uint8_t> active(n, 0);
    const LcpResult r = solve_lcp(W, q, z, active, *workspace, 0, {});
    if (r.status != SolveStatus::solved) continue;
    ++solved;
    wrong += residual_of(W, q, z) > 10 * LcpOptions{}.tolerance;
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(solved, 0.99 * problems);
}

INSTANTIATE_TEST_SUITE_P(Compliances, Apart, testing::Values(1.0, 1e4, 1e6, 1e12));

// One eigenvalue below zero: there may be no solution, and what is called one has to be one.
TEST(SolvedIsTrue, OfCompliancesThatAreSlightlyIndefinite) {
  Random random(23);
  const auto lcp = std::make_unique<LcpWorkspace>();
  const auto coulomb = std::make_unique<CoulombWorkspace>();
  int wrong = 0;
  for (int trial = 0; trial < 10000; ++trial) {
    const int n = 3 * (1 + trial % 6);
    MatX W = random_psd(random, n, n);
    const VecX v = VecX::NullaryExpr(n, [&] { return normal(random); }).normalized();
    const double least = v.dot(W * v);
    W -= (least + std::pow(10, uniform(random, -8, -1)) * W.trace() / n) * v * v.transpose();
    if (W.diagonal().minCoeff() <= 0) continue;
    VecX q(n), z = VecX::Zero(n), lambda = VecX::Zero(n);
    for (int i = 0; i < n; ++i) q[i] = W(i, i) * uniform(random, -1, 0.3);
    std::vector<std::uint8_t> active(n, 0);
    if (solve_lcp(W, q, z, active, *lcp, 0, {}).status == SolveStatus::solved)
      wrong += residual_of(W, q, z) > 10 * LcpOptions{}.tolerance;
    const std::vector<double> mu(n / 3, 0.3);
    const CoulombResult r = solve_coulomb(W, q, mu, lambda, *coulomb, 0, {});
    if (r.status == SolveStatus::solved && r.relative_diagonal < 1e-6)
      wrong += residual_of(W, q, lambda, mu, r.relative_diagonal) > 10 * CoulombOptions{}.tolerance;
  }
  EXPECT_EQ(wrong, 0);
}

TEST(SolvedIsTrue, NothingIsSolvedThatIsNotANumber) {
  Random random(24);
  const auto lcp = std::make_unique<LcpWorkspace>();
  const auto coulomb = std::make_unique<CoulombWorkspace>();
  for (int trial = 0; trial < 2000; ++trial) {
    const int n = 3 * (1 + trial % 5);
    MatX W = random_psd(random, n, n);
    VecX q = VecX::NullaryExpr(n, [&] { return uniform(random, -1, 0.3); }), z = VecX::Zero(n), lambda = z;
    std::vector<double> mu(n / 3, 0.3);
    const auto i = static_cast<Eigen::Index>(random() % n), j = static_cast<Eigen::Index>(random() % n);
    const double bad = trial % 3 == 0 ? nan : trial % 3 == 1 ? infinity : -infinity;
    const int where = trial % 4;
    if (where == 0) W(i, j) = bad;
    if (where == 1) q[i] = bad;
    if (where == 2) mu[static_cast<std::size_t>(i / 3)] = bad;
    if (where == 3) q *= 1e202 / q.cwiseAbs().maxCoeff();
    EXPECT_EQ(solve_coulomb(W, q, mu, lambda, *coulomb, 0, {}).status, SolveStatus::not_finite) << trial;
    EXPECT_TRUE(lambda.isZero(0));
    std::vector<std::uint8_t> active(n, 1);
    if (where > 1) continue;
    EXPECT_EQ(solve_lcp(W, q, z, active, *lcp, 0, {}).status, SolveStatus::not_finite) << trial;
    EXPECT_TRUE(z.isZero(0));
  }
}

TEST(SolvedIsTrue, WhateverTheStart) {
  Random random(25);
  const auto workspace = std::make_unique<CoulombWorkspace>();
  for (const double start : {1e9, 1e18, 1e202, -1e18, infinity, nan}) {
    for (int trial = 0; trial < 300; ++trial) {
      const int n = 1 + trial % 6;
      const MatX W = random_psd(random, 3 * n, 3 * n);
      VecX q(3 * n);
      for (int i = 0; i < 3 * n; ++i) q[i] = uniform(random, -1, 0.3);
      const std::vector<double> mu(n, 0.4);
      VecX lambda = VecX::Constant(3 * n, start), cold = VecX::Zero(3 * n);
      const CoulombResult r = solve_coulomb(W, q, mu, lambda, *workspace, 0, {});
      ASSERT_EQ(r.status, SolveStatus::solved) << start;
      EXPECT_LT(residual_of(W, q, lambda, mu, r.relative_diagonal), 1e-7);
      solve_coulomb(W, q, mu, cold, *workspace, 0, {});
      EXPECT_LT((lambda - cold).norm(), 1e-5 * (1 + cold.norm()));
    }
  }
}

TEST(SolvedIsTrue, AResidualOfNoNumberIsNoNumber) {
  const MatX W = MatX::Identity(6, 6);
  const VecX q = VecX::Constant(6, -1);
  const std::vector<double> mu(2, 0.4);
  for (int i = 0; i < 6; ++i) {
    VecX lambda = VecX::Ones(6);
    lambda[i] = nan;
    EXPECT_FALSE(coulomb_residual(W, q, lambda, mu) >= 0) << i;
  }
}

}  // namespace
}  // namespace hapticd
