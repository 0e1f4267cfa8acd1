// A partial factorisation of dense fronts, by every kernel that this processor runs.
#include "physics/compliance/front_kernels.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <string>
#include <vector>

#include "physics/types.h"
#include "tests/support/front_kernel_sets.h"

namespace hapticd {
namespace {

// A front of `size` rows whose first `width` are eliminated; memory outside its lower triangle is poisoned.
struct DenseFront {
  DenseFront(const MatX& A, int width_, bool fresh_)
      : width(width_), size(static_cast<int>(A.rows())), fresh(fresh_) {
    height = (size + row_multiple - 1) / row_multiple * row_multiple;
    stride = height + row_multiple;
    origin = square_origin(width);
    panel.assign(static_cast<std::size_t>(stride) * width + 8, 0.0);
    square.assign(static_cast<std::size_t>(stride) * (size - width) + 8, fresh ? 1e300 : 0.0);
    for (int j = 0; j < size; ++j)
      for (int i = j; i < size; ++i)
        if (j < width || !fresh) entry(i, j) = A(i, j);
  }

  double& entry(int i, int j) {
    return j < width ? panel[i + j * stride] : square[i - origin + (j - width) * stride];
  }

  bool run(const FrontKernels& kernels) {
    std::vector<double> reciprocal(width);
    if (!kernels.factor_panel(panel.data(), stride, height, width, reciprocal.data())) return false;
    for (int j = 0; j < width; ++j) EXPECT_DOUBLE_EQ(reciprocal[j], 1 / entry(j, j));
    kernels.subtract_square(panel.data(), stride, height, width, size, square.data(), stride, fresh);
    return true;
  }

  int width, size, height, stride, origin;
  bool fresh;
  std::vector<double> panel, square;
};

TEST(FrontKernels, AFrontByHand) {
  // A = L Lᵀ with L = [2 .; 3 1] and a third row [4 5]: what is left of 50 is 50 − 16 − 25 = 9.
  const MatX A = (MatX(3, 3) << 4, 6, 8, 6, 10, 17, 8, 17, 50).finished();
  for (const FrontKernels* kernels : front_kernel_sets()) {
    SCOPED_TRACE(kernels->name);
    DenseFront front(A, 2, false);
    ASSERT_TRUE(front.run(*kernels));
    EXPECT_EQ(front.entry(0, 0), 2);
    EXPECT_EQ(front.entry(1, 0), 3);
    EXPECT_EQ(front.entry(1, 1), 1);
    EXPECT_EQ(front.entry(2, 0), 4);
    EXPECT_EQ(front.entry(2, 1), 5);
    EXPECT_EQ(front.entry(2, 2), 9);
  }
}

TEST(FrontKernels, EveryWidthAndHeightEqualsTheDenseFactor) {
  for (const FrontKernels* kernels : front_kernel_sets())
    for (int size = 1; size <= 61; ++size) {
      const MatX G = MatX::Random(size, size);
      const MatX A = G * G.transpose() + MatX::Identity(size, size);
      for (int width = 1; width <= size; width += 1 + size / 12)
        for (const bool fresh : {false, true}) {
          SCOPED_TRACE(std::string(kernels->name) + " " + std::to_string(width) + " of " +
                       std::to_string(size) + (fresh ? " fresh" : ""));
          MatX expected = A;
          if (fresh) expected.bottomRightCorner(size - width, size - width).setZero();
          DenseFront front(expected, width, fresh);
          ASSERT_TRUE(front.run(*kernels));
          const MatX L11 = A.topLeftCorner(width, width).llt().matrixL();
          expected.topLeftCorner(width, width) = L11;
          if (width < size) {
            const MatX right = A.topRightCorner(width, size - width);
            const MatX L21 = L11.triangularView<Eigen::Lower>().solve(right).transpose();
            expected.bottomLeftCorner(size - width, width) = L21;
            expected.bottomRightCorner(size - width, size - width) -= L21 * L21.transpose();
          }
          double worst = 0;
          for (int j = 0; j < size; ++j)
            for (int i = j; i < size; ++i)
              worst = std::max(worst, std::abs(front.entry(i, j) - expected(i, j)));
          EXPECT_LT(worst, 1e-12 * A.norm());
        }
    }
}

TEST(FrontKernels, APivotThatIsNotPositiveIsRefused) {
  for (const FrontKernels* kernels : front_kernel_sets())
    for (const double pivot : {0.0, -1.0, std::nan("")}) {
      MatX A = MatX::Identity(21, 21);
      A(16, 16) = pivot;
      EXPECT_FALSE(DenseFront(A, 20, false).run(*kernels)) << kernels->name << " " << pivot;
      EXPECT_TRUE(DenseFront(A, 16, false).run(*kernels)) << kernels->name << " " << pivot;
    }
}

}  // namespace
}  // namespace hapticd
