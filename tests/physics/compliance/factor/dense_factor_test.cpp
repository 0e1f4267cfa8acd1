// A dense factor, by every kernel that this processor runs.
#include "physics/compliance/factor/dense_factor.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <string>

#include "tests/support/front_kernel_sets.h"

namespace hapticd {
namespace {

class DenseFactorOf : public testing::TestWithParam<const FrontKernels*> {};

// [4 2; 2 5] = L Lᵀ with L = [2 0; 1 2].
TEST_P(DenseFactorOf, TwoByTwoByHand) {
  DenseFactor factor(*GetParam());
  factor.resize(2);
  factor.matrix() << 4, 1e9, 2, 5;  // above the diagonal nothing is read
  ASSERT_TRUE(factor.factor());
  EXPECT_DOUBLE_EQ(factor.matrix()(0, 0), 2);
  EXPECT_DOUBLE_EQ(factor.matrix()(1, 0), 1);
  EXPECT_DOUBLE_EQ(factor.matrix()(1, 1), 2);
  factor.matrix() << 1, 0, 2, 3;
  EXPECT_FALSE(factor.factor());
}

TEST_P(DenseFactorOf, AnySizeAgainAndAgainAsEigen) {
  DenseFactor factor(*GetParam());
  for (const int n : {1, 3, 8, 9, 23, 24, 25, 48, 50, 75, 150, 60, 5}) {
    const MatX B = MatX::Random(n, n);
    const MatX S = B * B.transpose() + MatX::Identity(n, n);
    factor.resize(n);
    for (int again = 0; again < 2; ++again) {
      factor.matrix() = S;
      ASSERT_TRUE(factor.factor()) << n;
      const MatX L = factor.matrix().triangularView<Eigen::Lower>();
      EXPECT_LT((L - MatX(S.llt().matrixL())).norm(), 1e-12 * L.norm()) << n;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Kernels, DenseFactorOf, testing::ValuesIn(front_kernel_sets()),
                         [](const auto& of) { return std::string(of.param->name); });

}  // namespace
}  // namespace hapticd
