// Where a fixed-point iteration ends that is mixed, and when it is left alone.
#include "physics/simulation/body_contact/anderson_mixing.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

// Of a linear map the mixing of as many steps as it has modes ends at the fixed point: z = (I − A)⁻¹ b.
TEST(AndersonMixing, EndsALinearMapOfTwoModesInFourSteps) {
  MatX A(2, 2);
  A << 0.2, 0.4, 0.3, -0.1;
  const VecX b = Eigen::Vector2d(1, -2), fixed = (MatX::Identity(2, 2) - A).inverse() * b;
  AndersonMixing mixing;
  VecX z = VecX::Zero(2), plain = z;
  for (int k = 0; k < 4; ++k) {
    z = mixing.next(z, A * z + b);
    plain = A * plain + b;
  }
  EXPECT_LT((z - fixed).norm(), 1e-12);
  EXPECT_GT((plain - fixed).norm(), 0.01);
}

TEST(AndersonMixing, FollowsTheMapWhereItGetsNoNearer) {
  AndersonMixing mixing;
  const auto g = [](const VecX& z) -> VecX { return -1.5 * z; };
  VecX z = VecX::Ones(3);
  for (int k = 0; k < 5; ++k) {
    const VecX next = mixing.next(z, g(z));
    EXPECT_EQ(next, g(z));
    z = next;
  }
}

TEST(AndersonMixing, ForgetsStepsOfAnotherSize) {
  AndersonMixing mixing;
  mixing.next(VecX::Zero(2), VecX::Ones(2));
  mixing.next(VecX::Ones(2), VecX::Constant(2, 1.5));
  const VecX z = VecX::Zero(3), g = VecX::Constant(3, 0.1);
  EXPECT_EQ(mixing.next(z, g), g);
}

}  // namespace
}  // namespace hapticd
