#include "physics/contact/solver/lcp.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <limits>
#include <vector>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

using Exact = long double;
using ExactMat = Eigen::Matrix<Exact, Eigen::Dynamic, Eigen::Dynamic>;
using ExactVec = Eigen::Matrix<Exact, Eigen::Dynamic, 1>;

// W + εD, the matrix that the solver solves for.
MatX regularised(const MatX& W, double epsilon) {
  MatX A = W;
  A.diagonal() += epsilon * W.diagonal();
  return A;
}

// The least violated of all 2ⁿ active sets, in long double. W + εD is a P-matrix: the solution is unique.
struct Enumerated {
  ExactVec z, w;
  Exact violation = 1e30L;
};

Enumerated enumerate(const MatX& W, const VecX& q, double epsilon) {
  const int n = static_cast<int>(q.size());
  ExactMat A = W.cast<Exact>();
  A.diagonal() += static_cast<Exact>(epsilon) * W.diagonal().cast<Exact>();
  Enumerated best;
  for (unsigned set = 0; set < 1u << n; ++set) {
    std::vector<int> F;
    for (int i = 0; i < n; ++i)
      if (set >> i & 1u) F.push_back(i);
    ExactVec z = ExactVec::Zero(n);
    if (!F.empty()) {
      const ExactMat block = A(F, F);
      const ExactVec right = -q.cast<Exact>()(F);
      const ExactVec solution = block.ldlt().solve(right);
      z(F) = solution;
    }
    const ExactVec w = A * z + q.cast<Exact>();
    Exact violation = 0;
    const Exact z_scale = std::max<Exact>(z.cwiseAbs().maxCoeff(), 1e-300L);
    const Exact w_scale = std::max<Exact>(q.cwiseAbs().maxCoeff(), 1e-300);
    for (int i = 0; i < n; ++i)
      violation = std::max({violation, -z[i] / z_scale, set >> i & 1u ? Exact(0) : -w[i] / w_scale});
    if (violation < best.violation) best = {z, w, violation};
  }
  return best;
}

struct Solved {
  LcpResult result;
  VecX z;
  std::vector<std::uint8_t> active;
};

Solved solve(const MatX& W, const VecX& q, const LcpOptions& options = {},
             std::vector<std::uint8_t> active = {}) {
  static const auto workspace = std::make_unique<LcpWorkspace>();
  Solved s;
  s.z = VecX::Zero(q.size());
  s.active = active.empty() ? std::vector<std::uint8_t>(static_cast<std::size_t>(q.size()), 0) : active;
  s.result = solve_lcp(W, q, s.z, s.active, *workspace, 0, options);
  return s;
}

VecX two(double a, double b) {
  VecX v(2);
  v[0] = a;
  v[1] = b;
  return v;
}

VecX random_q(Random& random, int n) {
  VecX q(n);
  for (int i = 0; i < n; ++i) q[i] = normal(random);
  return q;
}

TEST(Lcp, OneContactIsFreeGapOverCompliance) {
  Random random(1);
  LcpOptions options;
  options.relative_diagonal = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    const double W = std::pow(10.0, uniform(random, -6, 3)), gap = normal(random);
    const Solved s = solve(MatX::Constant(1, 1, W), VecX::Constant(1, gap), options);
    const double expected = gap < 0 ? -gap / W : 0;
    EXPECT_NEAR(s.z[0], expected, 1e-12 * expected);
    EXPECT_EQ(s.result.active, gap < 0 ? 1 : 0);
  }
}

TEST(Lcp, TwoContactsByHand) {
  MatX W(2, 2);
  W << 2, 1, 1, 2;
  LcpOptions options;
  options.relative_diagonal = 0;
  EXPECT_LT((solve(W, two(-3, -3), options).z - two(1, 1)).norm(), 1e-14);
  // Pushing at the first opens the second: z₁ = 2, w₂ = 2 − 1 ≥ 0.
  EXPECT_LT((solve(W, two(-4, -1), options).z - two(2, 0)).norm(), 1e-14);
}

// Well posed: full rank. z itself must agree, to 1e-12 in the residual.
TEST(Lcp, AgreesWithEnumerationOnWellPosedProblems) {
  Random random(2);
  for (int trial = 0; trial < 3000; ++trial) {
    const int n = 1 + trial % 8;
    const MatX W = random_psd(random, n, n + 3);
    const VecX q = random_q(random, n);
    const Solved s = solve(W, q);
    const Enumerated exact = enumerate(W, q, LcpOptions().relative_diagonal);
    ASSERT_EQ(s.result.status, SolveStatus::solved);
    ASSERT_LT(s.result.residual, 1e-12);
    const double condition = static_cast<double>(W.diagonal().maxCoeff() * W.inverse().trace());
    ASSERT_LT((s.z - exact.z.cast<double>()).cwiseAbs().maxCoeff(),
              1e-13 * condition * (1 + static_cast<double>(exact.z.cwiseAbs().maxCoeff())))
        << trial;
  }
}

// Rank deficient, duplicated rows, q with ties and zeros: individual z may be ill determined, but the gap
// w and the elastic energy zᵀWz are not.
TEST(Lcp, AgreesWithEnumerationOnDegenerateProblems) {
  Random random(3);
  int ten_rows = 0;
  for (int trial = 0; trial < 2600; ++trial) {
    const int n = trial % 50 == 0 ? 10 : 2 + trial % 6;
    ten_rows += n == 10;
    const int rank = 1 + trial % std::max(1, n - 1);
    MatX B(n, rank);
    for (int k = 0; k < B.size(); ++k) B.data()[k] = normal(random);
    if (trial % 3 == 0) B.row(n - 1) = B.row(0);  // a duplicated contact
    // q = B g + s, s ≥ 0: opened by the motion −g, so that a force holds the contacts apart.
    VecX g = random_q(random, rank);
    if (trial % 5 == 0) g = -B.transpose() * random_q(random, n).cwiseMax(0.0);  // w = 0 wherever s = 0
    VecX q = B * g;
    for (int i = 0; i < n; ++i) q[i] += std::max(0.0, 0.5 * normal(random));
    if (trial % 5 == 1)
      for (int i = 0; i < n; ++i)
        if (q[i] < 0 && (B.row(i) * g)(0) < 0) q[i] = std::min(0.0, std::ceil(q[i]));  // ties and zeros in q
    if (trial % 3 == 0) q[n - 1] = q[0];
    const MatX W = B * B.transpose();
    const Solved s = solve(W, q);
    const Enumerated exact = enumerate(W, q, LcpOptions().relative_diagonal);
    ASSERT_LT(exact.violation, 1e-9L);
    ASSERT_EQ(s.result.status, SolveStatus::solved) << trial;
    const VecX w = regularised(W, 1e-9) * s.z + q;
    const double scale = 1 + q.cwiseAbs().maxCoeff();
    EXPECT_LT((w - exact.w.cast<double>()).cwiseAbs().maxCoeff(), 1e-5 * scale) << trial;
    const double energy = s.z.dot(W * s.z);
    const VecX z = exact.z.cast<double>();
    EXPECT_NEAR(energy, z.dot(W * z), 1e-5 * (1 + energy)) << trial;
    EXPECT_GE(s.z.minCoeff(), 0);
  }
  EXPECT_GT(ten_rows, 40);
}

TEST(Lcp, DuplicatesShareTheLoadEqually) {
  const MatX W = MatX::Constant(3, 3, 2.0);
  const Solved s = solve(W, VecX::Constant(3, -6.0));
  EXPECT_LT((s.z - VecX::Constant(3, 1.0)).norm(), 1e-6);
  EXPECT_NEAR(s.z.sum(), 3.0, 1e-8);
}

TEST(Lcp, WarmStartAtTheSolutionNeedsNoPivot) {
  Random random(4);
  for (int trial = 0; trial < 200; ++trial) {
    const MatX W = random_psd(random, 12, 15);
    const VecX q = random_q(random, 12);
    const Solved cold = solve(W, q);
    const Solved warm = solve(W, q, {}, cold.active);
    EXPECT_EQ(warm.result.pivots, 0);
    EXPECT_EQ(warm.z, cold.z);
  }
}

TEST(Lcp, CachedFactorGivesTheSameAnswerAndIsDroppedWithTheVersion) {
  Random random(5);
  const auto workspace = std::make_unique<LcpWorkspace>();
  const MatX W = random_psd(random, 8, 10);
  std::vector<std::uint8_t> active(8, 0);
  VecX z(8);
  for (int tick = 0; tick < 20; ++tick) {
    const VecX q = VecX::Constant(8, -1.0) + 0.1 * random_q(random, 8);
    solve_lcp(W, q, z, active, *workspace, 7, {});
    EXPECT_EQ(z, solve(W, q, {}, active).z);
  }
  const VecX q = VecX::Constant(8, -1.0);
  const MatX W2 = 2 * W;
  solve_lcp(W2, q, z, active, *workspace, 8, {});
  EXPECT_EQ(z, solve(W2, q, {}, active).z);
}

// Of a matrix that has its diagonal alone, columns are asked for before they are read: z is that of all of
// it, and contacts that open gaps hold apart are not asked.
TEST(Lcp, ColumnsOnDemandGiveTheSameAnswer) {
  struct Maker {
    const MatX& whole;
    MatX W;
    int asked = 0;
    std::vector<bool> made;
  };
  Random random(6);
  int rows = 0, asked = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const int n = 30;
    const MatX whole = random_psd(random, n, n + 3);
    const VecX q = random_q(random, n) + VecX::Constant(n, 1.0);
    Maker maker{whole, MatX::Constant(n, n, std::numeric_limits<double>::quiet_NaN()), 0,
                std::vector<bool>(static_cast<std::size_t>(n))};
    maker.W.diagonal() = whole.diagonal();
    LcpOptions options;
    options.columns = {[](void* to, int j) noexcept {
                         auto& m = *static_cast<Maker*>(to);
                         if (m.made[static_cast<std::size_t>(j)]) return;
                         m.made[static_cast<std::size_t>(j)] = true;
                         m.W.col(j) = m.whole.col(j);
                         ++m.asked;
                       },
                       &maker};
    const Solved s = solve(maker.W, q, options);
    EXPECT_EQ(s.result.status, SolveStatus::solved);
    EXPECT_EQ(s.z, solve(whole, q).z);
    rows += n;
    asked += maker.asked;
  }
  EXPECT_LT(asked, 0.8 * rows);
}

// Rigid obstacle: only the coupling's six freedoms move the rows.
struct RigidCase {
  MatX W;
  VecX q;
};

RigidCase rigid_case(std::uint64_t seed) {
  Random random(seed);
  const int n = 24;
  MatX J(n, 6);
  for (int i = 0; i < n; ++i) {
    const Vec3 normal_i = (Vec3::UnitZ() + 0.5 * unit_vector(random)).normalized();
    const Vec3 arm = unit_vector(random);
    J.row(i) << normal_i.transpose(), arm.cross(normal_i).transpose();
  }
  VecX twist(6);
  for (int k = 0; k < 6; ++k) twist[k] = normal(random);
  VecX q = J * twist;
  for (int i = 0; i < n; ++i) q[i] += 0.1 * std::abs(normal(random));
  return {J * J.transpose(), q};
}

TEST(Lcp, RigidObstaclesAreSolved) {
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    const RigidCase c = rigid_case(seed);
    const Solved s = solve(c.W, c.q);
    ASSERT_EQ(s.result.status, SolveStatus::solved) << seed;
    ASSERT_LT(s.result.residual, 1e-6) << seed;
  }
}

// Seeds for which block pivoting alone visits the same active sets for ever.
TEST(Lcp, WhereBlockPivotingCyclesTheDescentSolves) {
  LcpOptions blocks_only;
  blocks_only.patience = blocks_only.patience_with_few = 1 << 30;
  for (const std::uint64_t seed : {2, 3, 7, 11}) {
    const RigidCase c = rigid_case(seed);
    const Solved endless = solve(c.W, c.q, blocks_only);
    EXPECT_TRUE(endless.result.fell_back) << seed;
    EXPECT_GE(endless.result.pivots, blocks_only.max_pivots) << seed;
    const Solved s = solve(c.W, c.q);
    EXPECT_TRUE(s.result.fell_back) << seed;
    EXPECT_EQ(s.result.status, SolveStatus::solved);
    EXPECT_LT(s.result.residual, 1e-9);
    EXPECT_LT(s.result.pivots, 60);
  }
}

// From a cold start on many more sample points than the surface has freedoms, all of them overlapping.
TEST(Lcp, ManyMoreRowsThanFreedomsColdStart) {
  Random random(6);
  int fell_back = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const int n = 64, freedoms = 20;
    MatX B(n, freedoms);  // barycentric weights of three nodes
    B.setZero();
    for (int i = 0; i < n; ++i)
      for (int a = 0; a < 3; ++a) B(i, (i / 4 + a * 7) % freedoms) = uniform(random, 0.1, 1);
    const MatX C = random_psd(random, freedoms, freedoms + 4);
    VecX q(n);
    for (int i = 0; i < n; ++i) q[i] = -uniform(random, 0.2, 1);
    const Solved s = solve(B * C * B.transpose(), q);
    ASSERT_EQ(s.result.status, SolveStatus::solved) << trial;
    ASSERT_LT(s.result.residual, 1e-6) << trial;
    fell_back += s.result.fell_back;
  }
  EXPECT_GT(fell_back, 0);
}

// Squeezed between two rigid walls no motion opens both: only εD answers, but the answer is finite.
TEST(Lcp, InfeasibleWithoutTheDiagonalStaysFinite) {
  MatX W(2, 2);
  W << 1, -1, -1, 1;
  const Solved s = solve(W, two(-1, -1));
  EXPECT_EQ(s.result.status, SolveStatus::solved);
  EXPECT_NEAR(s.z[0] * 1e-9, 1.0, 1e-6);
  EXPECT_NEAR(s.z[1] * 1e-9, 1.0, 1e-6);
}

TEST(Lcp, NotFiniteIsAStatusAndZeroForce) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  MatX W = MatX::Identity(3, 3);
  VecX q = VecX::Constant(3, -1.0);
  q[1] = nan;
  EXPECT_EQ(solve(W, q).result.status, SolveStatus::not_finite);
  EXPECT_TRUE(solve(W, q).z.isZero(0));
  q[1] = -1;
  W(0, 2) = W(2, 0) = nan;
  EXPECT_EQ(solve(W, q).result.status, SolveStatus::not_finite);
  EXPECT_TRUE(solve(W, q).z.isZero(0));
}

TEST(Lcp, CapGivesTheBestIterateFiniteAndNotNegative) {
  LcpOptions options;
  options.max_pivots = 1;
  int capped = 0;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    const RigidCase c = rigid_case(seed);
    const Solved s = solve(c.W, c.q, options);
    capped += s.result.status == SolveStatus::iteration_cap;
    EXPECT_TRUE(s.z.allFinite());
    EXPECT_GE(s.z.minCoeff(), 0);
  }
  EXPECT_GT(capped, 0);
}

TEST(Lcp, NoRowsAndAMatrixOfZerosAreHarmless) {
  EXPECT_EQ(solve(MatX(0, 0), VecX(0)).result.status, SolveStatus::solved);
  EXPECT_EQ(solve(MatX::Zero(2, 2), two(1, 0)).result.status, SolveStatus::solved);
  EXPECT_EQ(solve(MatX::Zero(2, 2), two(1, -1)).result.status, SolveStatus::iteration_cap);
}

// z = 0 leaves the first gap closed by its whole size, whatever the second, open one would take to move: it
// has next to no compliance.
TEST(Lcp, ResidualIsNotMeasuredAgainstOpenRows) {
  MatX W = MatX::Zero(2, 2);
  W.diagonal() = two(1, 1e-14);
  LcpOptions options;
  options.max_pivots = 0;
  const Solved s = solve(W, two(-1, 1), options);
  EXPECT_EQ(s.z, two(0, 0));
  EXPECT_EQ(s.result.status, SolveStatus::iteration_cap);
  EXPECT_NEAR(s.result.residual, 1, 1e-12);
}

// Each z is finite, and what the first adds to the third gap less what the second takes from it is no number:
// 7e308 − 7e308.
TEST(Lcp, GapsThatAreNoNumbersAreNotSolved) {
  MatX W = MatX::Identity(3, 3);
  W(2, 0) = W(0, 2) = 700;
  W(2, 1) = W(1, 2) = -700;
  W(2, 2) = 1e6;
  VecX q(3);
  q << -1e306, -1e306, 1;
  const Solved s = solve(W, q, {});
  EXPECT_EQ(s.result.status, SolveStatus::not_finite);
  EXPECT_TRUE(s.z.isZero(0));
}

}  // namespace
}  // namespace hapticd
