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

}  // namespace
}  // namespace hapticd
