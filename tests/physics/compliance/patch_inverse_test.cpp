// A large patch of several pieces is inverted piece by piece: the same as all at once.
#include "physics/compliance/patch_inverse.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <numeric>
#include <random>

namespace hapticd {
namespace {

TEST(PatchInverse, OfPiecesThatMingleIsThatOfEach) {
  constexpr int nodes = 260, pieces = 4;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  MatX A = MatX::Zero(3 * nodes, 3 * nodes);
  for (int j = 0; j < nodes; ++j)
    for (int i = j; i < nodes; ++i) {
      if (i % pieces != j % pieces) continue;
      Mat3 block;
      for (int k = 0; k < 9; ++k) block.data()[k] = normal(random);
      A.block<3, 3>(3 * i, 3 * j) = block;
      A.block<3, 3>(3 * j, 3 * i) = block.transpose();
    }
  A = A * A.transpose() + MatX::Identity(3 * nodes, 3 * nodes);
  const MatX L = A.llt().matrixL();
  std::vector<int> places(nodes);
  std::iota(places.begin(), places.end(), 0);
  std::shuffle(places.begin(), places.end(), random);
  places[7] = -1;
  MatX block(3 * nodes, 3 * nodes);
  PatchInverse inverse;
  inverse(L, places, block);
  const MatX expected = A.inverse();
  double worst = 0;
  for (int i = 0; i < nodes; ++i)
    for (int j = 0; j < nodes; ++j) {
      const Mat3 found = block.block<3, 3>(3 * i, 3 * j);
      Mat3 known = Mat3::Zero();
      if (places[i] >= 0 && places[j] >= 0) known = expected.block<3, 3>(3 * places[i], 3 * places[j]);
      worst = std::max(worst, (found - known).norm());
      if (places[i] % pieces != places[j] % pieces) {
        EXPECT_TRUE(found.isZero(0));
      }
    }
  EXPECT_LT(worst, 1e-9 * expected.norm());
}

// Whatever tiles of the kernels its rows lie across.
TEST(PatchInverse, ANodeThatIsNamedTwiceHasItsOwnBlockTwice) {
  constexpr int nodes = 12;
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  MatX A(3 * nodes, 3 * nodes);
  for (Eigen::Index i = 0; i < A.size(); ++i) A.data()[i] = normal(random);
  A = A * A.transpose() + MatX::Identity(3 * nodes, 3 * nodes);
  const MatX L = A.llt().matrixL(), expected = A.inverse();
  std::vector<int> places(2 * nodes);
  for (int k = 0; k < 2 * nodes; ++k) places[k] = k % nodes;
  MatX block(6 * nodes, 6 * nodes);
  PatchInverse inverse;
  inverse(L, places, block);
  EXPECT_LT((block - expected.replicate(2, 2)).norm(), 1e-9 * expected.norm());
}

// Patches that move on over one factor, with nodes outside its corner: each is what the whole inverse has.
TEST(PatchInverse, APatchThatMovesOnUsesWhatIsKnown) {
  constexpr int outside = 3, corner = 90, nodes = outside + corner;
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  MatX A(3 * nodes, 3 * nodes);
  for (Eigen::Index i = 0; i < A.size(); ++i) A.data()[i] = normal(random);
  A = A * A.transpose() + MatX::Identity(3 * nodes, 3 * nodes);
  const MatX whole = A.llt().matrixL(), expected = A.inverse();
  const MatX L = whole.bottomRightCorner(3 * corner, 3 * corner);
  const MatX E = MatX::Identity(3 * nodes, 3 * outside);
  const MatX Y = whole.triangularView<Eigen::Lower>().solve(E);
  PatchInverse inverse;
  std::vector<int> all(corner);
  std::iota(all.begin(), all.end(), 0);
  for (int k = 0; k < 40; ++k) {
    // Half of the nodes before, and others; few of many now and then.
    std::shuffle(all.begin() + (k % 2 == 0 ? 0 : 20), all.end(), random);
    std::vector<int> places(all.begin(), all.begin() + (k % 7 == 6 ? 5 : 40)), at;
    places.insert(places.begin() + 3, outside, -1);
    at = places;
    const std::vector<int> out = {3, 4, 5};
    const auto size = static_cast<Eigen::Index>(places.size());
    MatX block(3 * size, 3 * size);
    inverse(L, std::vector<int>{0}, places, out, Y, k > 0, block);
    double worst = 0;
    for (Eigen::Index i = 0; i < size; ++i)
      for (Eigen::Index j = 0; j < size; ++j) {
        const auto place = [&](Eigen::Index n) { return at[n] < 0 ? n - 3 : at[n] + outside; };
        worst = std::max(
            worst,
            (block.block<3, 3>(3 * i, 3 * j) - expected.block<3, 3>(3 * place(i), 3 * place(j))).norm());
      }
    EXPECT_LT(worst, 1e-9 * expected.norm()) << k;
  }
}

}  // namespace
}  // namespace hapticd
