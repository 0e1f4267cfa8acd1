// A partial factorisation of dense fronts, by every kernel that this processor runs.
#include "physics/compliance/factor/front_kernels.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "physics/types.h"
#include "tests/support/front_kernel_sets.h"

namespace hapticd {
namespace {

// A front of `size` rows whose first `width` are eliminated; memory outside its lower triangle is poisoned.
struct DenseFront {
  DenseFront(const MatX& A, int width_) : width(width_), size(static_cast<int>(A.rows())) {
    height = (size + row_multiple - 1) / row_multiple * row_multiple;
    stride = height + row_multiple;
    origin = contribution_origin(width);
    panel.assign(static_cast<std::size_t>(stride) * width + 8, 0.0);
    contribution.assign(static_cast<std::size_t>(stride) * (size - width) + 8, 1e300);
    for (int j = 0; j < width; ++j)
      for (int i = j; i < size; ++i) entry(i, j) = A(i, j);
  }

  double& entry(int i, int j) {
    return j < width ? panel[i + j * stride] : contribution[i - origin + (j - width) * stride];
  }

  bool run(const FrontKernels& kernels) {
    std::vector<double> reciprocal(width);
    FrontAhead nothing;
    if (!kernels.factor_panel(panel.data(), stride, height, width, reciprocal.data(), nothing)) return false;
    for (int j = 0; j < width; ++j) EXPECT_DOUBLE_EQ(reciprocal[j], 1 / entry(j, j));
    kernels.make_contribution(panel.data(), stride, height, width, size, contribution.data(), stride,
                              nothing);
    return true;
  }

  int width, size, height, stride, origin;
  std::vector<double> panel, contribution;
};

TEST(FrontKernels, AFrontByHand) {
  // A = L Lᵀ with L = [2 .; 3 1] and a third row [4 5]: the contribution block is −16 − 25.
  const MatX A = (MatX(3, 3) << 4, 6, 8, 6, 10, 17, 8, 17, 50).finished();
  for (const FrontKernels* kernels : front_kernel_sets()) {
    SCOPED_TRACE(kernels->name);
    DenseFront front(A, 2);
    ASSERT_TRUE(front.run(*kernels));
    EXPECT_EQ(front.entry(0, 0), 2);
    EXPECT_EQ(front.entry(1, 0), 3);
    EXPECT_EQ(front.entry(1, 1), 1);
    EXPECT_EQ(front.entry(2, 0), 4);
    EXPECT_EQ(front.entry(2, 1), 5);
    EXPECT_EQ(front.entry(2, 2), -41);
  }
}

TEST(FrontKernels, EveryWidthAndHeightEqualsTheDenseFactor) {
  for (const FrontKernels* kernels : front_kernel_sets())
    for (int size = 1; size <= 61; ++size) {
      const MatX G = MatX::Random(size, size);
      const MatX A = G * G.transpose() + MatX::Identity(size, size);
      for (int width = 1; width <= size; width += 1 + size / 12) {
        SCOPED_TRACE(std::string(kernels->name) + " " + std::to_string(width) + " of " +
                     std::to_string(size));
        DenseFront front(A, width);
        ASSERT_TRUE(front.run(*kernels));
        MatX expected = MatX::Zero(size, size);
        const MatX L11 = A.topLeftCorner(width, width).llt().matrixL();
        expected.topLeftCorner(width, width) = L11;
        if (width < size) {
          const MatX right = A.topRightCorner(width, size - width);
          const MatX L21 = L11.triangularView<Eigen::Lower>().solve(right).transpose();
          expected.bottomLeftCorner(size - width, width) = L21;
          expected.bottomRightCorner(size - width, size - width) = -L21 * L21.transpose();
        }
        double worst = 0;
        for (int j = 0; j < size; ++j)
          for (int i = j; i < size; ++i)
            worst = std::max(worst, std::abs(front.entry(i, j) - expected(i, j)));
        EXPECT_LT(worst, 1e-12 * A.norm());
      }
    }
}

// A child of 3 rows that are rows 1, 2 and 9 of its parent, its contribution block [4 . .; 5 6 .; 7 8 9].
TEST(FrontKernels, AChildByHand) {
  constexpr double no = 1e300;  // above the diagonal: of no meaning
  const std::vector<double> contribution = {4, 5, 7, no, no, 6, 8, no, no, no, 9, no, 0, 0, 0, 0, 0, 0, 0, 0};
  const FrontChunk chunks[] = {{0, 0, 0b110}, {8, 2, 0b10}};
  for (const FrontKernels* kernels : front_kernel_sets()) {
    SCOPED_TRACE(kernels->name);
    alignas(64) double parent[10][16] = {};
    kernels->add_child(contribution.data(), 4, chunks, chunks + 2, 0, 2, &parent[0][0], 16);
    MatX expected = MatX::Zero(16, 10);
    expected(1, 1) = 4;
    expected(2, 1) = 5;
    expected(9, 1) = 7;
    EXPECT_EQ(Eigen::Map<const MatX>(&parent[0][0], 16, 10), expected);
    kernels->add_child(contribution.data(), 4, chunks, chunks + 2, 2, 10, &parent[0][0], 16);
    expected(2, 2) = 6;
    expected(9, 2) = 8;
    expected(9, 9) = 9;
    EXPECT_EQ(Eigen::Map<const MatX>(&parent[0][0], 16, 10), expected);
  }
}

TEST(FrontKernels, ChildrenOfAnyRowsEqualTheSumEntryByEntry) {
  std::mt19937 random(5);
  for (const FrontKernels* kernels : front_kernel_sets())
    for (int trial = 0; trial < 50; ++trial) {
      constexpr int height = 64;
      std::vector<int> row;
      for (int r = 0; r < height; ++r)
        if (random() % 3 != 0) row.push_back(r);
      std::vector<FrontChunk> chunks;
      for (int k = 0; k < static_cast<int>(row.size()); ++k) {
        if (chunks.empty() || row[k] >= chunks.back().row + row_multiple)
          chunks.push_back({row[k] / row_multiple * row_multiple, k, 0});
        chunks.back().mask |= 1U << row[k] % row_multiple;
      }
      const auto count = static_cast<Eigen::Index>(row.size());
      const MatX contribution = MatX::Random(count + 8, count + 1);
      const int begin = static_cast<int>(random() % height);
      alignas(64) double parent[height][height] = {};
      kernels->add_child(contribution.data(), count + 8, chunks.data(), chunks.data() + chunks.size(), begin,
                         height, &parent[0][0], height);
      MatX expected = MatX::Zero(height, height);
      for (int j = 0; j < count; ++j)
        for (int i = j; i < count && row[j] >= begin; ++i) expected(row[i], row[j]) = contribution(i, j);
      EXPECT_EQ(Eigen::Map<const MatX>(&parent[0][0], height, height), expected) << kernels->name;
    }
}

TEST(FrontKernels, APivotThatIsNotPositiveIsRefused) {
  for (const FrontKernels* kernels : front_kernel_sets())
    for (const double pivot : {0.0, -1.0, std::nan("")}) {
      MatX A = MatX::Identity(21, 21);
      A(16, 16) = pivot;
      EXPECT_FALSE(DenseFront(A, 20).run(*kernels)) << kernels->name << " " << pivot;
      EXPECT_TRUE(DenseFront(A, 16).run(*kernels)) << kernels->name << " " << pivot;
    }
}

// Rows of (L⁻¹)ᵀ that begin at any columns, and their products; memory that no row has begun in is poisoned.
TEST(FrontKernels, RowsOfAnInverseAndTheirProducts) {
  std::mt19937 random(3);
  for (const FrontKernels* kernels : front_kernel_sets())
    for (const int size : {1, 3, 8, 21, 64, 75}) {
      const MatX G = MatX::Random(size, size);
      const MatX A = G * G.transpose() + MatX::Identity(size, size), inverse = A.inverse();
      MatX L = A.llt().matrixL();
      L.triangularView<Eigen::StrictlyUpper>().setConstant(std::nan(""));
      constexpr int first_rows = 2 * most_tile_rows, rows = 4 * most_tile_rows;
      std::vector<int> begins(rows, size);  // the last of each half fill a tile up
      for (int half : {0, first_rows}) {
        const auto from = begins.begin() + half, to = from + first_rows - 5;
        std::generate(from, to, [&] { return static_cast<int>(random() % size); });
        std::sort(from, to);
      }
      MatX Y = MatX::Constant(rows + row_multiple, size, std::nan("")), C = MatX::Constant(rows, rows, 7);
      for (int row = 0; row < rows; row += most_tile_rows) {
        const int begin = begins[row] / row_multiple * row_multiple;
        Y.block(row, begin, most_tile_rows, size - begin).setZero();
        for (int r = row; r < row + most_tile_rows; ++r)
          if (begins[r] < size) Y(r, begins[r]) = 1;
      }
      std::vector<double> inverses(static_cast<std::size_t>(size * (row_multiple + 1)));
      for (const auto& [first, last] : {std::pair(0, first_rows), std::pair(first_rows, rows)}) {
        kernels->solve_rows(L.data(), size, size, begins.data(), first, last, Y.data(), Y.rows(),
                            inverses.data());
        kernels->multiply_rows(Y.data(), Y.rows(), size, begins.data(), first, last, C.data(), rows);
      }
      for (int j = 0; j < rows; ++j)
        for (int i = j; i < rows; ++i) {
          const bool filler = begins[i] == size || begins[j] == size;
          EXPECT_NEAR(C(i, j), filler ? 0 : -inverse(begins[i], begins[j]), 1e-12)
              << kernels->name << " " << size << " " << i << " " << j;
        }
    }
}

}  // namespace
}  // namespace hapticd
