// The convex baseline finds the minimum of its own problem, which without friction is the LCP's answer.
#include "tools/chart/solver/sap_baseline.h"

#include <gtest/gtest.h>

#include <memory>
#include <random>

#include "physics/contact/solver/coulomb.h"

namespace hapticd {
namespace {

struct Drawn {
  MatX W;
  VecX q;
};

Drawn draw(int rows, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto filled = [&](int r, int c) {
    return MatX(MatX::NullaryExpr(r, c, [&] { return normal(random); }));
  };
  const MatX B = filled(rows, rows / 2 + 1);
  return {B * B.transpose() + 0.1 * MatX::Identity(rows, rows), filled(rows, 1)};
}

TEST(SapBaseline, WithoutFrictionItIsTheLcpOfTheSameDiagonal) {
  const auto workspace = std::make_unique<LcpWorkspace>();
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Drawn d = draw(20, seed);
    SapOptions options;
    options.relative_diagonal = 1e-3;
    options.tolerance = 1e-10;
    VecX sap = VecX::Zero(20), lcp = sap;
    ASSERT_TRUE(solve_sap(d.W, d.q, {}, sap, options).solved) << seed;
    std::vector<std::uint8_t> active(20, 0);
    LcpOptions of_lcp;
    of_lcp.relative_diagonal = 1e-3;
    ASSERT_EQ(solve_lcp(d.W, d.q, lcp, active, *workspace, 0, of_lcp).status, SolveStatus::solved);
    EXPECT_LT((sap - lcp).norm(), 1e-6 * (1 + lcp.norm())) << seed;
  }
}

TEST(SapBaseline, ItsAnswerIsTheProjectionOfItsOwnGaps) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Drawn d = draw(30, seed);
    const std::vector<double> mu(10, 0.1 + 0.02 * seed);
    VecX lambda = VecX::Zero(30);
    SapOptions options;
    options.relative_diagonal = 1e-3;
    options.tolerance = 1e-10;
    const SapResult r = solve_sap(d.W, d.q, mu, lambda, options);
    ASSERT_TRUE(r.solved) << seed;
    const VecX delta = d.W * lambda + d.q;
    for (int i = 0; i < 10; ++i) {
      const double R = 1e-3 * d.W.diagonal().segment<3>(3 * i).mean();
      const Vec3 own = project_on_cone(-delta.segment<3>(3 * i) / R, mu[i]);
      EXPECT_LT((own - lambda.segment<3>(3 * i)).norm(), 1e-4 * (1 + lambda.norm())) << seed << ", " << i;
    }
  }
}

}  // namespace
}  // namespace hapticd
