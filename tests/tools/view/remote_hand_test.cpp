// Whatever a viewer asks for, the hand stays in its workspace and does not jump.
#include "tools/view/remote_hand.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace hapticd {
namespace {

TEST(RemoteHand, ATargetIsReachedAtTheHandsSpeed) {
  Vec3 x = Vec3::Zero();
  for (int i = 0; i < 100; ++i) x = bounded_target(x, {0.01, 0, 0}, 0.1, 1e-3);
  EXPECT_EQ(x, Vec3(0.01, 0, 0));
  EXPECT_NEAR(bounded_target(Vec3::Zero(), {0.01, 0, 0}, 0.1, 1e-3).norm(), hand_speed * 1e-3, 1e-12);
}

TEST(RemoteHand, AnyTargetsKeepWorkspaceAndSpeed) {
  std::mt19937 random(1);
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               infinite = std::numeric_limits<double>::infinity();
  const double values[] = {0, 0.01, -0.05, 1e9, -1e300, nan, infinite, -infinite};
  Vec3 x = Vec3::Zero();
  for (int i = 0; i < 100'000; ++i) {
    const Vec3 wanted(values[random() % 8], values[random() % 8], values[random() % 8]);
    const Vec3 next = bounded_target(x, wanted, 0.07, 1e-3);
    ASSERT_TRUE(next.allFinite());
    ASSERT_LE(next.norm(), 0.07 * (1 + 1e-12));
    ASSERT_LE((next - x).norm(), hand_speed * 1e-3 * (1 + 1e-9));
    x = next;
  }
}

}  // namespace
}  // namespace hapticd
