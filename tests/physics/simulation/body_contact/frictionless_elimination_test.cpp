// Bodies' contacts eliminated: the same forces as of all contacts in one Coulomb problem.
#include "physics/simulation/body_contact/frictionless_elimination.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <random>

namespace hapticd {
namespace {

TEST(FrictionlessElimination, AgreesWithOneProblemOfAll) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  int solved = 0;
  double worst = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const int nb = 1 + static_cast<int>(random() % 40), nt = 1 + static_cast<int>(random() % 12);
    const int rows = nb + 3 * nt;
    MatX G(rows, rows + 5);
    for (Eigen::Index i = 0; i < G.size(); ++i) G.data()[i] = normal(random);
    const MatX W = G * G.transpose() / rows + 0.1 * MatX::Identity(rows, rows);
    VecX q(rows);
    for (Eigen::Index i = 0; i < rows; ++i) q[i] = 1e-3 * normal(random);
    const std::vector<double> mu(nt, 0.1 + 0.1 * (trial % 3));
    VecX lambda_b = VecX::Zero(nb), lambda_t = VecX::Zero(3 * nt);
    LcpWorkspace lcp(rows);
    CoulombWorkspace coulomb(nb + nt);
    CoulombOptions options;
    options.tolerance = 1e-10;
    const EliminationResult r = solve_eliminated(
        W.topLeftCorner(nb, nb), q.head(nb), lambda_b, W.bottomLeftCorner(3 * nt, nb),
        W.bottomRightCorner(3 * nt, 3 * nt), q.tail(3 * nt), mu, {}, lambda_t, lcp, coulomb, options);
    if (!r.solved) {
      EXPECT_TRUE(lambda_b.isZero(0));
      EXPECT_TRUE(lambda_t.isZero(0));
      continue;
    }
    ++solved;
    // As one: a contact of the bodies has two rows more, which are coupled to nothing.
    const int all = nb + nt;
    MatX one = MatX::Zero(3 * all, 3 * all);
    VecX q_one = VecX::Zero(3 * all), found = VecX::Zero(3 * all);
    std::vector<int> row;
    for (int i = 0; i < nb; ++i) row.push_back(3 * i);
    for (int i = 0; i < 3 * nt; ++i) row.push_back(3 * nb + i);
    for (int i = 0; i < rows; ++i) {
      q_one[row[i]] = q[i];
      found[row[i]] = i < nb ? lambda_b[i] : lambda_t[i - nb];
      for (int j = 0; j < rows; ++j) one(row[i], row[j]) = W(i, j);
    }
    std::vector<double> friction(nb, 0.0);
    friction.insert(friction.end(), mu.begin(), mu.end());
    worst = std::max(worst, coulomb_residual(one, q_one, found, friction));
  }
  std::printf("  %d of 200 solved, residual of all at most %.1e\n", solved, worst);
  EXPECT_GE(solved, 190);
  EXPECT_LT(worst, 1e-7);
}

}  // namespace
}  // namespace hapticd
