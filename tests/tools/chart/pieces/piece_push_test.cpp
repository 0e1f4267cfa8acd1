// What the haptic loop feels of bodies in contact: the reference of the chart is the step's own answer, and a
// block that sticks is felt within what is asked.
#include "tools/chart/pieces/piece_push.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

TEST(PiecePush, ABlockThatSticksOnAnotherIsFeltAsItIs) {
  const std::vector<PushPoint> pushes = push_block(0.5, {}, {});
  ASSERT_EQ(pushes.size(), 5u);
  for (const PushPoint& p : pushes) {
    EXPECT_TRUE(holds(p));
    EXPECT_EQ(p.unsolved, 0);
    EXPECT_LT(p.at_rest_rel, 1e-6) << p.direction;  // nothing is frozen wrongly where nothing moves
    EXPECT_LT(p.step_rel, 1e-6) << p.direction;     // at the end of the way the step says the same
    EXPECT_LE(p.rms_rel, 0.03) << p.direction;
  }
  EXPECT_EQ(worst_rms_rel({}), 0);
}

}  // namespace
}  // namespace hapticd
