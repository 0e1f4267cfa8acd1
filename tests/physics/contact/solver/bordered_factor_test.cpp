// Solutions with the bordered factor, by every kernel that this processor runs.
#include "physics/contact/solver/bordered_factor.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <limits>
#include <string>

#include "tests/support/contact_problems.h"
#include "tests/support/front_kernel_sets.h"

namespace hapticd {
namespace {

MatX random_matrix(Random& random, int rows, int columns) {
  MatX A(rows, columns);
  for (int j = 0; j < columns; ++j)
    for (int i = 0; i < rows; ++i) A(i, j) = normal(random);
  return A;
}

// Writes M with its first `definite` unknowns as S; memory before first_row is poisoned.
void write(const MatX& M, int definite, BorderedFactor& factor) {
  const int border = static_cast<int>(M.rows()) - definite;
  factor.resize(definite, border);
  for (int k = 0; k < definite; ++k) {
    double* out = factor.column(k);
    std::fill_n(out, BorderedFactor::first_row(k), 1e300);
    for (int i = BorderedFactor::first_row(k); i < definite + border; ++i) out[i] = M(i, k);
    for (int j = 0; j < border; ++j) out[definite + border + j] = M(k, definite + j);
  }
  for (int j = 0; j < border; ++j)
    for (int i = 0; i < border; ++i) factor.corner(j)[i] = M(definite + i, definite + j);
}

VecX solution(const BorderedFactor& factor, const VecX& b, int border) {
  VecX x(b.size() + border);
  x.head(b.size()) = b;
  factor.solve(x.data());
  return x.head(b.size());
}

// Symmetric positive definite, and a border as friction makes it: rows N = B P, columns P B (1 + a part
// more).
MatX bordered_matrix(Random& random, int definite, int border) {
  const int n = definite + border;
  MatX M = random_psd(random, n, n) + 0.05 * MatX::Identity(n, n);
  M.rightCols(border) += 0.5 * M * random_matrix(random, n, border) / std::max(1, n);
  return M;
}

TEST(BorderedFactor, TwoUnknownsByHand) {
  const MatX M = (MatX(2, 2) << 4, 6, 2, 5).finished();
  for (const FrontKernels* kernels : front_kernel_sets()) {
    SCOPED_TRACE(kernels->name);
    BorderedFactor factor(6);
    write(M, 1, factor);
    ASSERT_TRUE(factor.factor(*kernels));
    EXPECT_EQ(solution(factor, Eigen::Vector2d(10, 7), 1), Eigen::Vector2d(1, 1));
    EXPECT_EQ(factor.pivot_ratio(), 0.5);  // 4, and 5 − 2 · 6 / 4 = 2
  }
}

// In one factor's memory, as the solver has it.
TEST(BorderedFactor, EverySizeEqualsADenseSolveWithEveryKernel) {
  Random random(3);
  BorderedFactor factor(180);
  for (int definite = 0; definite <= 60; ++definite)
    for (int border = definite == 0 ? 1 : 0; border <= 60; border += 1 + border / 3 + definite % 5) {
      const MatX M = bordered_matrix(random, definite, border);
      const VecX b = random_matrix(random, definite + border, 1).col(0);
      const VecX expected = M.fullPivLu().solve(b);
      for (const FrontKernels* kernels : front_kernel_sets()) {
        SCOPED_TRACE(std::string(kernels->name) + " " + std::to_string(definite) + " + " +
                     std::to_string(border));
        write(M, definite, factor);
        ASSERT_TRUE(factor.factor(*kernels));
        const VecX x = solution(factor, b, border);
        EXPECT_LE((M * x - b).norm(), 1e-12 * M.norm() * x.norm());
        EXPECT_LE((x - expected).norm(), 1e-9 * expected.norm());
        EXPECT_EQ(solution(factor, b, border), x);  // solving leaves the factor as it was
      }
    }
}

TEST(BorderedFactor, IndefiniteSingularAndNotFiniteAreRefused) {
  const double no = std::numeric_limits<double>::quiet_NaN(),
               infinite = std::numeric_limits<double>::infinity();
  for (const FrontKernels* kernels : front_kernel_sets())
    for (const int bad : {0, 9, 19, 20, 25}) {
      BorderedFactor factor(66);
      for (const double pivot : {0.0, no, infinite}) {
        MatX M = MatX::Identity(26, 26);
        M(bad, bad) = pivot;
        write(M, 20, factor);
        EXPECT_FALSE(factor.factor(*kernels)) << kernels->name << " " << bad << " " << pivot;
      }
      MatX M = MatX::Identity(26, 26);
      M(bad, bad) = -1;
      write(M, 20, factor);
      EXPECT_EQ(factor.factor(*kernels), bad >= 20)
          << "only S must be definite: " << kernels->name << " " << bad;
      write(MatX::Identity(26, 26), 20, factor);
      EXPECT_TRUE(factor.factor(*kernels)) << "what was refused is forgotten: " << kernels->name;
    }
}

}  // namespace
}  // namespace hapticd
