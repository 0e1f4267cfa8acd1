// What contacts that stick leave to the others, against the formula. Whole solves with and without it:
// tests/tools/chart/solver/flat_tip_test.cpp.
#include "physics/contact/solver/sticking_elimination.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "physics/contact/solver/coulomb_newton.h"
#include "tests/support/contact_problems.h"
#include "tests/support/front_kernel_sets.h"

namespace hapticd {
namespace {

struct Case {
  explicit Case(std::uint64_t seed) : random(seed) {}

  Random random;
  int contacts = 0;
  MatX W;
  VecX q;
  std::vector<double> mu, rho, anchor;
  std::vector<int> R, P;  // rows of W

  void make(int of_them) {
    contacts = of_them;
    const int rows = 3 * contacts;
    W = random_psd(random, rows, rows) + 0.1 * MatX::Identity(rows, rows);
    q.resize(rows);
    anchor.resize(static_cast<std::size_t>(rows));
    for (int k = 0; k < rows; ++k)
      q[k] = normal(random), anchor[static_cast<std::size_t>(k)] = normal(random);
    mu.assign(static_cast<std::size_t>(contacts), 0.5);
    rho.clear();
    for (int i = 0; i < contacts; ++i) rho.push_back(3 / W.block<3, 3>(3 * i, 3 * i).trace());
  }

  // A third sticks, a third is another, a third is in neither list; at least one sticks.
  void sort(StickingElimination& elimination) {
    elimination.clear();
    R.clear(), P.clear();
    for (int i = 0; i < contacts; ++i) {
      const int which = i == 0 ? 0 : static_cast<int>(uniform(random, 0, 3));
      if (which == 2) continue;
      elimination.take(i, which == 0);
      for (int k = 0; k < 3; ++k) (which == 0 ? R : P).push_back(3 * i + k);
    }
  }
};

TEST(StickingElimination, LeavesTheSchurComplement) {
  Case c(1);
  for (const FrontKernels* kernels : front_kernel_sets()) {
    SCOPED_TRACE(kernels->name);
    for (int trial = 0; trial < 60; ++trial) {
      c.make(1 + trial % 40);
      StickingElimination elimination(40);
      c.sort(elimination);
      const Eigen::Ref<const MatX> W(c.W);
      const Eigen::Ref<const VecX> q(c.q);
      CoulombSystem system{W, q, c.mu, {}, c.rho, 1e-3, c.contacts, 7};
      if (trial % 2) system.anchor = c.anchor.data();
      ASSERT_TRUE(elimination.factor(system, *kernels));
      EXPECT_TRUE(elimination.kept(system));
      elimination.reduce(system);

      MatX A = c.W;
      VecX b = c.q;
      for (int k = 0; k < A.rows(); ++k) {
        A(k, k) += system.diagonal(k / 3);
        if (system.anchor) b[k] -= system.diagonal(k / 3) * c.anchor[static_cast<std::size_t>(k)];
      }
      const Eigen::LLT<MatX> of_R(MatX(A(c.R, c.R)));
      const MatX S = A(c.P, c.P) - A(c.P, c.R) * of_R.solve(MatX(A(c.R, c.P)));
      const VecX left = b(c.P) - A(c.P, c.R) * of_R.solve(VecX(b(c.R)));
      EXPECT_LT((elimination.S() - S).norm(), 1e-12 * A.norm());
      EXPECT_EQ(MatX(elimination.S()), MatX(elimination.S().transpose()));
      EXPECT_LT((elimination.q() - left).norm(), 1e-11 * b.norm());

      VecX of_P(c.P.size()), lambda(b.size());
      for (double& x : of_P) x = normal(c.random);
      elimination.recover(of_P.data(), {lambda.data(), static_cast<std::size_t>(lambda.size())});
      const VecX delta = A * lambda + b;
      EXPECT_EQ(VecX(lambda(c.P)), of_P);
      EXPECT_LT(delta(c.R).norm(), 1e-11 * b.norm());
      EXPECT_LT((delta(c.P) - (S * of_P + left)).norm(), 1e-11 * b.norm());
    }
  }
}

TEST(StickingElimination, TheFactorServesWhileTheMatrixAndTheListsStay) {
  Case c(2);
  c.make(10);
  StickingElimination elimination(10);
  c.sort(elimination);
  const Eigen::Ref<const MatX> W(c.W);
  const Eigen::Ref<const VecX> q(c.q);
  const CoulombSystem system{W, q, c.mu, {}, c.rho, 1e-9, 10, 7};
  CoulombSystem other_version = system, other_diagonal = system;
  other_version.version = 8;
  other_diagonal.epsilon = 1e-4;
  EXPECT_FALSE(elimination.kept(system));
  ASSERT_TRUE(elimination.factor(system));
  EXPECT_TRUE(elimination.kept(system));
  EXPECT_FALSE(elimination.kept(other_version));
  EXPECT_FALSE(elimination.kept(other_diagonal));
  c.sort(elimination);
  EXPECT_FALSE(elimination.kept(system));
}

TEST(StickingElimination, AnIndefiniteMatrixHasNoFactor) {
  Case c(3);
  c.make(6);
  c.W(0, 0) = -1;
  StickingElimination elimination(6);
  for (int i = 0; i < 6; ++i) elimination.take(i, true);
  const Eigen::Ref<const MatX> W(c.W);
  const Eigen::Ref<const VecX> q(c.q);
  EXPECT_FALSE(elimination.factor({W, q, c.mu, {}, c.rho, 0, 6, 7}));
}

}  // namespace
}  // namespace hapticd
