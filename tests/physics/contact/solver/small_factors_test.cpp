#include "physics/contact/solver/small_factors.h"

#include <gtest/gtest.h>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

// With the padding that the factors ask for.
std::vector<double> padded_columns(const MatX& A) {
  const int n = static_cast<int>(A.rows()), ld = padded(n);
  std::vector<double> out(static_cast<std::size_t>(ld) * n, 0.0);
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) out[static_cast<std::size_t>(j) * ld + i] = A(i, j);
  return out;
}

MatX random_matrix(Random& random, int n) {
  MatX A(n, n);
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) A(i, j) = normal(random);
  return A;
}

// Every size across blocks and strips; the matrix has no structure, so rows must be exchanged.
TEST(SmallFactors, LuSolvesEverySize) {
  Random random(1);
  int exchanged = 0;
  for (int n = 1; n <= 70; ++n) {
    const MatX A = random_matrix(random, n);
    const VecX x = random_matrix(random, n).col(0);
    VecX b = A * x;
    std::vector<double> lu = padded_columns(A);
    std::vector<int> pivot(n);
    ASSERT_TRUE(lu_factor(lu.data(), n, pivot.data())) << n;
    lu_solve(lu.data(), n, pivot.data(), b.data());
    for (int k = 0; k < n; ++k) exchanged += pivot[k] != k;
    EXPECT_LE((A * b - A * x).norm(), 1e-11 * A.norm() * b.norm()) << n;
  }
  EXPECT_GT(exchanged, 100);
}

TEST(SmallFactors, CholeskySolvesEverySize) {
  Random random(2);
  for (int n = 1; n <= 70; ++n) {
    const MatX A = random_psd(random, n, n) + 0.01 * MatX::Identity(n, n);
    const VecX x = random_matrix(random, n).col(0);
    VecX b = A * x;
    std::vector<double> factor = padded_columns(A);
    cholesky(factor.data(), n, 1e-15);
    cholesky_solve(factor.data(), n, b.data());
    EXPECT_LE((A * b - A * x).norm(), 1e-13 * A.norm() * b.norm()) << n;
  }
}

TEST(SmallFactors, SingularAndNotFiniteAreRefused) {
  MatX A = MatX::Identity(20, 20);
  std::vector<int> pivot(20);
  A(17, 17) = 0;
  std::vector<double> lu = padded_columns(A);
  EXPECT_FALSE(lu_factor(lu.data(), 20, pivot.data()));
  A(17, 17) = std::numeric_limits<double>::quiet_NaN();
  lu = padded_columns(A);
  EXPECT_FALSE(lu_factor(lu.data(), 20, pivot.data()));
}

}  // namespace
}  // namespace hapticd
