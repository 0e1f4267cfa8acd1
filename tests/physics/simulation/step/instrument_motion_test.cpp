// The instrument's twist is its way over the time that passed, and nothing where either is unknown.
#include "physics/simulation/step/instrument_motion.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

constexpr double h = 0.02;

InstrumentSample at(double x, double time) {
  InstrumentSample s;
  s.pose.p.x() = x;
  s.present = true;
  s.time = time;
  return s;
}

TEST(InstrumentMotion, ATwistIsTheWayOverTheTimeThatPassed) {
  InstrumentMotion motion;
  motion.follow(at(1e-3, 5), h);
  EXPECT_TRUE(motion.twist().isZero(0)) << "one sample is no motion";
  motion.follow(at(3e-3, 5.04), h);
  EXPECT_NEAR(motion.way()[0], 2e-3, 1e-15);
  EXPECT_NEAR(motion.twist()[0], 2e-3 / 0.04, 1e-9);
  motion.follow(at(4e-3, 0), h);
  EXPECT_NEAR(motion.twist()[0], 1e-3 / h, 1e-9) << "without a time it is a step";
}

// Two samples a microsecond apart would be a speed that no hand has.
TEST(InstrumentMotion, NoLessThanATenthOfAStepPasses) {
  InstrumentMotion motion;
  motion.follow(at(0, 5), h);
  motion.follow(at(1e-4, 5 + 1e-6), h);
  EXPECT_NEAR(motion.twist()[0], 1e-4 / (0.1 * h), 1e-9);
}

TEST(InstrumentMotion, ADeviceThatWasAwayBeginsAtRest) {
  InstrumentMotion motion;
  motion.follow(at(0, 5), h);
  motion.follow({}, h);
  EXPECT_FALSE(motion.present());
  EXPECT_FALSE(motion.is_at(at(0, 0)));
  motion.follow(at(1, 5.04), h);
  EXPECT_TRUE(motion.present());
  EXPECT_TRUE(motion.twist().isZero(0));
  EXPECT_TRUE(motion.predictor().in(3, 1).isZero(0));
  EXPECT_TRUE(motion.is_at(at(1, 0)));
  EXPECT_FALSE(motion.is_at(at(1 + 1e-12, 0)));
}

}  // namespace
}  // namespace hapticd
