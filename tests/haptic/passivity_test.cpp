#include "haptic/passivity.h"

#include <gtest/gtest.h>

#include <cmath>

namespace hapticd {
namespace {

constexpr double tick = 1e-3;  // [s]

// Its force may change at once.
DeviceSettings damped(double b) {
  DeviceSettings device;
  device.damping = b;
  device.max_force_rate = 0;
  return device;
}

Pose at(double x) { return {Vec3(x, 0, 0), Quat::Identity()}; }

TEST(Passivity, PressingASampledSpringInAndOutMakesTheEnergyOfTheHold) {
  // F_k = −K x_k held for one tick: in over N steps of Δ costs K Δ² N(N−1)/2, out gives K Δ² N(N+1)/2.
  constexpr double K = 1000, step = 1e-4;
  constexpr int N = 20;
  PassivityState state;
  Wrench held;
  for (int k = 0; k <= 2 * N; ++k) {
    const double x = step * (k <= N ? k : 2 * N - k);
    observe(state, at(x), held, tick);
    held.force = Vec3(-K * x, 0, 0);
    if (k == N) {
      EXPECT_NEAR(state.energy, K * step * step * N * (N - 1) / 2, 1e-15);
    }
  }
  EXPECT_NEAR(state.energy, -K * step * step * N, 1e-15);
}

TEST(Passivity, AStillHandDoesNoWorkAndADamperOnlyTakes) {
  PassivityState state;
  observe(state, at(0), {}, tick);
  observe(state, at(0), {Vec3(3, 0, 0), Vec3::Zero()}, tick);
  EXPECT_EQ(state.energy, 0);
  for (int k = 1; k < 10; ++k) observe(state, at(0.001 * k), {Vec3(-0.5, 0, 0), Vec3::Zero()}, tick);
  EXPECT_NEAR(state.energy, 0.0045, 1e-12);
  EXPECT_EQ(passive(state, {}, Vec3(1, 0, 0), damped(5), tick).force, Vec3::Zero());
}

TEST(Passivity, RotationWorksAgainstTorque) {
  PassivityState state;
  observe(state, at(0), {}, tick);
  const Pose turned{Vec3::Zero(), Quat(Eigen::AngleAxisd(0.2, Vec3::UnitZ()))};
  observe(state, turned, {Vec3::Zero(), Vec3(0, 0, -0.1)}, tick);
  EXPECT_NEAR(state.energy, 0.02, 1e-12);
}

TEST(Passivity, ADeficitIsTakenBackInOneTickWhereDampingAllows) {
  PassivityState state;
  state.tank = -1e-6;
  const Vec3 v(0.02, 0, 0);
  const Vec3 f = passive(state, {}, v, damped(5), tick).force;
  EXPECT_NEAR(f.dot(v) * tick, -1e-6, 1e-18);  // dissipates exactly the deficit
  EXPECT_NEAR(passive(state, {}, v, damped(1), tick).force.x(), -0.02, 1e-15);  // capped at b = 1
}

TEST(Passivity, TheForceGivesWhatTheTankHasAlongTheMotionAndKeepsTheRest) {
  PassivityState state;
  const Vec3 v(0.1, 0, 0);
  const Wrench pushes{Vec3(0.5, 0.2, 0), Vec3::Zero()};
  // Empty: nothing along the motion, and beside it what gives 0.5 µJ to 50 g at rest.
  const Vec3 beside(0, 0.2 * std::sqrt(0.5e-6 / 2.9e-6), 0);
  EXPECT_NEAR((passive(state, pushes, v, damped(0), tick).force - beside).norm(), 0, 1e-15);
  state.tank = 2e-5;  // of the 5e-5 J that it is about to give
  EXPECT_NEAR((passive(state, pushes, v, damped(0), tick).force - Vec3(0.2, 0.2, 0)).norm(), 0, 1e-15);
  state.tank = 1e-4;
  EXPECT_EQ(passive(state, pushes, v, damped(5), tick).force, pushes.force);
  state.tank = 3e-6;  // a force against the motion, or on a hand at rest, is left alone
  EXPECT_EQ(passive(state, pushes, -v, damped(5), tick).force, pushes.force);
  EXPECT_EQ(passive(state, pushes, Vec3::Zero(), damped(5), tick).force, pushes.force);
}

TEST(Passivity, AHandThatIsFlungAwayIsCaughtByItsNewestMotion) {
  PassivityState state;
  observe(state, at(0), {}, tick);
  observe(state, at(1e-4), {}, tick);  // 0.1 m/s, of which a smooth velocity knows little yet
  state.tank = 1e-5;
  const Wrench pushes{Vec3(0.5, 0, 0), Vec3::Zero()};
  EXPECT_NEAR(passive(state, pushes, Vec3(0.01, 0, 0), damped(0), tick).force.x(), 0.1, 1e-12);
}

TEST(Passivity, AForceThatCannotFallAtOnceIsHeldBackEarlier) {
  PassivityState state;
  DeviceSettings slow = damped(0);
  slow.max_force_rate = 100;  // 0.5 N take 5 ms: on the way down half of it goes on
  state.tank = 1e-4;
  const Vec3 v(0.1, 0, 0);
  const Wrench pushes{Vec3(0.5, 0, 0), Vec3::Zero()};
  EXPECT_EQ(passive(state, pushes, v, damped(0), tick).force.x(), 0.5);
  EXPECT_NEAR(passive(state, pushes, v, slow, tick).force.x(), 1e-4 / (3.5e-3 * 0.1), 1e-12);
}

TEST(Passivity, WhatWasRubbedOffIsNoCreditAndWhatAPumpDoesIs) {
  PassivityState state;
  const Wrench friction{Vec3(-0.1, 0, 0), Vec3::Zero()};
  for (int k = 0; k <= 1000; ++k) observe(state, at(1e-4 * k), friction, tick);  // 10 mJ
  EXPECT_NEAR(state.energy, 0.01, 1e-12);
  EXPECT_NEAR(state.tank, 0.1 * 5e-3, 1e-12);  // the force over 5 mm
  observe(state, at(0.1), {}, tick);
  EXPECT_EQ(state.tank, 0);  // no force, nothing to give back
  observe(state, at(0.1), {}, tick, 1e-6);
  EXPECT_EQ(state.tank, 1e-6);
}

TEST(Passivity, ASpringThatIsPressedAndLetGoIsNotTouched) {
  // As stiff as it likes: what was put in comes back whole, but for the energy of the hold.
  constexpr double K = 200, step = 1e-5;
  PassivityState state;
  Wrench sent;
  double cut = 0, most = 0;
  Vec3 v = Vec3::Zero();
  for (int k = 0; k <= 400; ++k) {
    const double x = step * (k <= 200 ? k : 400 - k);
    v.x() = k <= 200 ? step / tick : -step / tick;
    observe(state, at(x), sent, tick);
    const Wrench spring{Vec3(-K * x, 0, 0), Vec3::Zero()};
    sent = passive(state, spring, v, damped(0), tick);
    cut = std::max(cut, (sent.force - spring.force).norm());
    most = std::max(most, K * x);
  }
  EXPECT_LT(cut, 0.11 * most);      // only where it is nearly out
  EXPECT_GT(state.energy, -1e-12);  // and it makes nothing
}

}  // namespace
}  // namespace hapticd
