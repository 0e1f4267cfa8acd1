#include "tools/client/hand_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace hapticd {
namespace {

HandSettings bare() {
  HandSettings hand;
  hand.mass = 0.1;
  hand.stiffness = 300;
  hand.damping = 0;
  hand.device_damping = 0;
  return hand;
}

// f = √(k/m) / 2π, by counting upward zero crossings over 20 periods.
TEST(HandModel, FreeOscillationHasTheFrequencyOfItsSpringAndMass) {
  const HandSettings hand = bare();
  const double h = 1e-4, expected = std::sqrt(hand.stiffness / hand.mass) / (2 * std::numbers::pi);
  HandState state{Vec3(0.001, 0, 0), Vec3::Zero()};
  double first = -1, last = -1;
  int crossings = 0;
  for (int i = 0; crossings <= 20; ++i) {
    const double before = state.x.x();
    state = advanced(hand, state, {}, Vec3::Zero(), h);
    if (before < 0 && state.x.x() >= 0) {
      last = h * (i - before / (state.x.x() - before));
      if (crossings++ == 0) first = last;
    }
  }
  EXPECT_NEAR((crossings - 1) / (last - first), expected, 1e-3 * expected);
}

// The symplectic integrator keeps the amplitude: a free oscillation neither grows nor fades.
TEST(HandModel, FreeOscillationKeepsItsAmplitude) {
  HandState state{Vec3(0.001, 0, 0), Vec3::Zero()};
  double late = 0;
  for (int i = 0; i < 200'000; ++i) {
    state = advanced(bare(), state, {}, Vec3::Zero(), 1e-4);
    if (i > 190'000) late = std::max(late, state.x.norm());
  }
  EXPECT_NEAR(late, 0.001, 1e-5);
}

TEST(HandModel, ASteadyForceDeflectsByForceOverStiffness) {
  HandSettings hand = bare();
  hand.damping = 4;
  HandState state;
  const Vec3 force(0.3, -0.6, 0.9);
  for (int i = 0; i < 50'000; ++i) state = advanced(hand, state, {}, force, 1e-4);
  EXPECT_LT((state.x - force / 300).norm(), 1e-9);
}

TEST(HandModel, FrictionHoldsBelowItsThresholdAndOnlyThere) {
  HandSettings hand = bare();
  hand.friction = 0.2;
  HandState state;
  for (int i = 0; i < 1000; ++i) state = advanced(hand, state, {}, Vec3(0.19, 0, 0), 1e-4);
  EXPECT_EQ(state.x.norm(), 0);
  for (int i = 0; i < 1000; ++i) state = advanced(hand, state, {}, Vec3(0.21, 0, 0), 1e-4);
  EXPECT_GT(state.x.x(), 0);
}

// m dv/dt = −f_c: a sliding mass stops after v m / f_c.
TEST(HandModel, FrictionStopsASlidingMassInTheTimeOfItsImpulse) {
  HandSettings hand = bare();
  hand.stiffness = 0;
  hand.friction = 0.5;
  HandState state{Vec3::Zero(), Vec3(0.03, 0.04, 0)};
  int steps = 0;
  for (; state.v.norm() > 0; ++steps) state = advanced(hand, state, {}, Vec3::Zero(), 1e-5);
  EXPECT_NEAR(1e-5 * steps, 0.05 * 0.1 / 0.5, 2e-5);
}

TEST(HandModel, TheEncoderReadsTheNearestMultiple) {
  EXPECT_LT((quantised(Vec3(1.24e-4, -1.26e-4, 0), 5e-5) - Vec3(1e-4, -1.5e-4, 0)).norm(), 1e-18);
  EXPECT_EQ(quantised(Vec3(1.234e-4, 0, 0), 0).x(), 1.234e-4);
}

TEST(HandModel, SaturationKeepsTheDirection) {
  EXPECT_LT((saturated(Vec3(3, 4, 0), 2.5) - Vec3(1.5, 2, 0)).norm(), 1e-15);
  EXPECT_EQ(saturated(Vec3(3, 4, 0), 0), Vec3(3, 4, 0));
  EXPECT_EQ(saturated(Vec3(3, 4, 0), 5), Vec3(3, 4, 0));
}

TEST(HandModel, ADelayedForceActsNotBeforeItsTime) {
  ForceDelay delay(2e-3);
  EXPECT_EQ(delay.at(1'000'000'000), Vec3::Zero());
  delay.push(10'000'000, Vec3(1, 0, 0));
  delay.push(11'000'000, Vec3(2, 0, 0));
  EXPECT_EQ(delay.at(11'999'999), Vec3::Zero());
  EXPECT_EQ(delay.at(12'000'000).x(), 1);
  EXPECT_EQ(delay.at(12'999'999).x(), 1);
  EXPECT_EQ(delay.at(13'000'000).x(), 2);
  EXPECT_EQ(delay.at(99'000'000).x(), 2);
}

TEST(HandModel, ADelayThatOverflowsForgetsTheOldestFirst) {
  ForceDelay delay(1e-3);
  for (int i = 0; i < 600; ++i) delay.push(i, Vec3(i, 0, 0));
  EXPECT_EQ(delay.at(599 + 1'000'000).x(), 599);
}

// A passive spring gives back what it took; one that answers late makes energy.
TEST(HandModel, TheObserverCountsWorkDoneOnTheServerAsPositive) {
  PassivityObserver spring, wrong;
  Vec3 x(0, 0, 0);
  for (int i = 0; i < 1000; ++i) {
    const Vec3 next(1e-5 * (i + 1), 0, 0);
    spring.add(-100 * (0.5 * (x + next)), next - x);
    wrong.add(100 * next, next - x);
    x = next;
  }
  EXPECT_NEAR(spring.energy, 0.5 * 100 * 1e-4, 1e-12);
  EXPECT_EQ(spring.minimum, 0);
  EXPECT_LT(wrong.minimum, -0.0049);
}

TEST(HandModel, APressGoesToItsDepthAndBackWithoutAJump) {
  Press press;
  press.depth = 0.004;
  press.speed = 0.02;
  press.hold = 0.5;
  EXPECT_DOUBLE_EQ(press.duration(), 0.9);
  EXPECT_LT((target_at(press, 0.3).x - Vec3(0, 0, -0.004)).norm(), 1e-15);
  EXPECT_EQ(target_at(press, -1).x, Vec3::Zero());
  EXPECT_EQ(target_at(press, 2).x, Vec3::Zero());
  const double h = 1e-6;
  for (double t = 0.0005; t < 1; t += 0.001) {  // v is the derivative of x, everywhere
    const Vec3 v = (target_at(press, t + h).x - target_at(press, t - h).x) / (2 * h);
    EXPECT_LT((v - target_at(press, t).v).norm(), 1e-6) << t;
  }
}

TEST(HandModel, RefusesWhatIsNoHand) {
  HandSettings hand;
  EXPECT_NO_THROW(check(hand));
  hand.mass = 0;
  EXPECT_THROW(check(hand), std::invalid_argument);
  hand = {};
  hand.damping = -1;
  EXPECT_THROW(check(hand), std::invalid_argument);
  hand = {};
  hand.delay = 1;
  EXPECT_THROW(check(hand), std::invalid_argument);
}

}  // namespace
}  // namespace hapticd
