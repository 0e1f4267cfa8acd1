// Normal forces with a limit (edges of blades): enumeration of all active sets and a plain projected
// Gauss-Seidel are the oracles.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <optional>

#include "physics/contact/solver/coulomb.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

struct Problem {
  MatX W;
  VecX q;
  std::vector<double> mu, limit;
  int contacts() const { return static_cast<int>(mu.size()); }
};

struct Solved {
  CoulombResult result;
  VecX lambda;
};

Solved solve(const Problem& p, const CoulombOptions& options = {}) {
  static const auto workspace = std::make_unique<CoulombWorkspace>();
  Solved s;
  s.lambda = VecX::Zero(p.q.size());
  s.result = solve_coulomb(p.W, p.q, p.mu, s.lambda, *workspace, 0, options, p.limit);
  return s;
}

CoulombOptions exact() {
  CoulombOptions options;
  options.tolerance = 1e-11;
  options.relative_diagonal = 1e-13;
  return options;
}

// Points of a soft sheet on an instrument that a coupling holds: W = G + c J Jᵀ. distinct < contacts: the
// rest are copies, so W is rank-deficient.
Problem random_problem(Random& random, int contacts, int distinct, double share_of_edges) {
  Problem p;
  MatX H = MatX::Zero(3 * contacts, 3 * distinct), J(3 * contacts, 6);
  std::vector<Vec3> place;
  for (int i = 0; i < distinct; ++i) place.push_back(Vec3(uniform(random, -1, 1), uniform(random, -1, 1), 0));
  for (int i = 0; i < contacts; ++i) {
    const int at = i % distinct;
    const Mat3 F = Quat(Eigen::AngleAxisd(uniform(random, 0, 0.6), unit_vector(random))).toRotationMatrix();
    H.block<3, 3>(3 * i, 3 * at) = F.transpose();
    for (int c = 0; c < 3; ++c)
      J.row(3 * i + c) << F.col(c).transpose(),
          place[static_cast<std::size_t>(at)].cross(F.col(c)).transpose();
  }
  MatX G(3 * distinct, 3 * distinct);
  for (int a = 0; a < distinct; ++a)
    for (int b = 0; b < distinct; ++b)
      G.block<3, 3>(3 * a, 3 * b) =
          std::exp(-3 * (place[static_cast<std::size_t>(a)] - place[static_cast<std::size_t>(b)]).norm()) *
          Mat3::Identity();
  p.W = H * G * H.transpose() + 0.05 * J * J.transpose();
  p.q.resize(3 * contacts);
  for (int i = 0; i < contacts; ++i) {
    const bool edge = uniform(random, 0, 1) < share_of_edges;
    p.q.segment<3>(3 * i) =
        Vec3(normal(random) - 1.0, edge ? 0 : 0.3 * normal(random), edge ? 0 : 0.3 * normal(random));
    p.mu.push_back(edge ? 0 : uniform(random, 0.05, 0.3));
    p.limit.push_back(edge ? uniform(random, 0.02, 0.6) : no_limit);
  }
  return p;
}

// The three cases of every edge, tried one after another: the one set that meets all conditions.
VecX enumerate(const MatX& W, const VecX& q, const std::vector<double>& limit) {
  const int n = static_cast<int>(q.size());
  int sets = 1;
  for (int i = 0; i < n; ++i) sets *= 3;
  std::optional<VecX> found;
  for (int set = 0; set < sets; ++set) {
    std::vector<int> inside;
    VecX l = VecX::Zero(n);
    for (int i = 0, rest = set; i < n; ++i, rest /= 3) {
      if (rest % 3 == 1) inside.push_back(i);
      if (rest % 3 == 2) l[i] = limit[static_cast<std::size_t>(i)];
    }
    const auto k = static_cast<Eigen::Index>(inside.size());
    MatX A(k, k);
    VecX b(k);
    const VecX held = W * l + q;
    for (Eigen::Index r = 0; r < k; ++r) {
      b[r] = -held[inside[static_cast<std::size_t>(r)]];
      for (Eigen::Index c = 0; c < k; ++c)
        A(r, c) = W(inside[static_cast<std::size_t>(r)], inside[static_cast<std::size_t>(c)]);
    }
    const VecX x = A.llt().solve(b);
    for (Eigen::Index r = 0; r < k; ++r) l[inside[static_cast<std::size_t>(r)]] = x[r];
    const VecX delta = W * l + q;
    bool holds = true;
    for (int i = 0, rest = set; i < n; ++i, rest /= 3) {
      if (rest % 3 == 0) holds = holds && delta[i] >= 0;
      if (rest % 3 == 1) holds = holds && l[i] >= 0 && l[i] <= limit[static_cast<std::size_t>(i)];
      if (rest % 3 == 2) holds = holds && delta[i] <= 0;
    }
    if (holds) found = l;
  }
  EXPECT_TRUE(found);
  return found.value_or(VecX::Zero(n));
}

// Projected Gauss-Seidel until nothing moves: a normal force at a time, then the two tangential ones of its contact,
// with one factor for both, so that a force on the disc is against its slip.
VecX projected_gauss_seidel(const Problem& p) {
  VecX l = VecX::Zero(p.q.size());
  for (int sweep = 0; sweep < 200000; ++sweep) {
    const VecX before = l;
    for (int i = 0; i < p.contacts(); ++i) {
      const auto at = static_cast<std::size_t>(i);
      const int n = 3 * i;
      l[n] = std::min(std::max(0.0, l[n] - (p.W.row(n).dot(l) + p.q[n]) / p.W(n, n)), p.limit[at]);
      const Eigen::Vector2d slip = p.W.middleRows<2>(n + 1) * l + p.q.segment<2>(n + 1);
      l.segment<2>(n + 1) -= slip / (p.W(n + 1, n + 1) + p.W(n + 2, n + 2));
      const double disc = p.mu[at] * l[n], t = l.segment<2>(n + 1).norm();
      if (t > disc) l.segment<2>(n + 1) *= disc / t;
    }
    if ((l - before).norm() <= 1e-15 * l.norm()) break;
  }
  return l;
}

TEST(Limit, OneRowIsTheContactsForceUpToItsLimit) {
  Random random(1);
  int open = 0, limited = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    const Mat3 A = random_psd(random, 3, 3) + 0.1 * Mat3::Identity();
    const Vec3 b(normal(random), normal(random), normal(random));
    const double limit = uniform(random, 0, 1);
    const Vec3 l = solve_coulomb_contact(A, b, 0, limit);
    EXPECT_EQ(l, Vec3(std::min(std::max(0.0, -b[0] / A(0, 0)), limit), 0, 0));
    open += l[0] == 0;
    limited += l[0] == limit;
  }
  EXPECT_GT(open, 100);
  EXPECT_GT(limited, 100);
}

TEST(Limit, CoupledEdgesAgreeWithAllActiveSets) {
  Random random(2);
  int count[3] = {};
  for (int trial = 0; trial < 600; ++trial) {
    const int n = 1 + trial % 6;
    const Problem p = random_problem(random, n, n, 1);
    const Solved s = solve(p, exact());
    ASSERT_EQ(s.result.status, SolveStatus::solved) << trial << " residual " << s.result.residual;
    MatX W(n, n);
    VecX q(n), l(n);
    for (int i = 0; i < n; ++i) {
      q[i] = p.q[3 * i];
      l[i] = s.lambda[3 * i];
      for (int j = 0; j < n; ++j) W(i, j) = p.W(3 * i, 3 * j);
    }
    const VecX oracle = enumerate(W, q, p.limit);
    EXPECT_LT((l - oracle).norm(), 1e-9 * (1 + oracle.norm())) << trial;
    for (int i = 0; i < n; ++i)
      ++count[oracle[i] == 0 ? 0 : oracle[i] < p.limit[static_cast<std::size_t>(i)] ? 1 : 2];
  }
  for (const int c : count) EXPECT_GT(c, 150);
}

TEST(Limit, WithFrictionBesideThemItIsProjectedGaussSeidelsForce) {
  Random random(3);
  int limited = 0, sliding = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const int n = 2 + trial % 24;
    const Problem p = random_problem(random, n, n, 0.4);
    const Solved s = solve(p, exact());
    ASSERT_EQ(s.result.status, SolveStatus::solved) << trial << " residual " << s.result.residual;
    EXPECT_LE(coulomb_residual(p.W, p.q, s.lambda, p.mu, p.limit), 1e-8) << trial;
    const VecX oracle = projected_gauss_seidel(p);
    ASSERT_LE(coulomb_residual(p.W, p.q, oracle, p.mu, p.limit), 1e-11) << trial;
    EXPECT_LT((s.lambda - oracle).norm(), 1e-7 * oracle.norm()) << trial;
    for (int i = 0; i < n; ++i) limited += s.lambda[3 * i] == p.limit[static_cast<std::size_t>(i)];
    sliding += s.result.sliding;
  }
  EXPECT_GT(limited, 300);
  EXPECT_GT(sliding, 300);
}

// Hyperstatic contacts: single forces are not unique, gaps are.
TEST(Limit, RedundantContactsAndEdgesAreSolved) {
  Random random(4);
  int limited = 0, rounds = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const int n = 6 + trial % 40;
    const Problem p = random_problem(random, n, std::max(2, n / 4), 0.25);
    const Solved s = solve(p);
    EXPECT_EQ(s.result.status, SolveStatus::solved) << trial << " residual " << s.result.residual;
    EXPECT_LE(coulomb_residual(p.W, p.q, s.lambda, p.mu, p.limit), 1e-6) << trial;
    for (int i = 0; i < n; ++i) {
      const double l = s.lambda[3 * i], limit = p.limit[static_cast<std::size_t>(i)];
      EXPECT_TRUE(l >= 0 && l <= limit);
      limited += l == limit;
    }
    rounds += s.result.rounds;
  }
  EXPECT_GT(limited, 300);
  EXPECT_GE(rounds, 0);
}

TEST(Limit, NoLimitAndAnInfiniteOneAreTheSameBits) {
  Random random(5);
  for (int trial = 0; trial < 100; ++trial) {
    const int n = 1 + trial % 30;
    Problem p = random_problem(random, n, n, 0.2);
    p.limit.assign(p.limit.size(), no_limit);
    const VecX with = solve(p).lambda;
    p.limit.clear();
    EXPECT_EQ((solve(p).lambda - with).norm(), 0);
  }
}

TEST(Limit, ZeroGivesNoForceAndNoNumberIsRefused) {
  Random random(6);
  Problem p = random_problem(random, 5, 5, 1);
  p.q.setConstant(-1);
  p.limit.assign(5, 0.0);
  const Solved none = solve(p);
  EXPECT_EQ(none.result.status, SolveStatus::solved);
  EXPECT_TRUE(none.lambda.isZero(0));
  for (const double bad : {-1e-9, std::numeric_limits<double>::quiet_NaN()}) {
    p.limit[3] = bad;
    EXPECT_EQ(solve(p).result.status, SolveStatus::not_finite);
  }
}

}  // namespace
}  // namespace hapticd
