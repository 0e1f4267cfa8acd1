#include "haptic/limits.h"

#include <limits>
#include <random>

#include <gtest/gtest.h>

#include <numbers>

namespace hapticd {
namespace {

DeviceSettings device() {
  DeviceSettings d;
  d.max_force = 3;
  d.max_torque = 0.3;
  d.max_force_rate = 100;
  return d;
}

TEST(Limits, SaturationKeepsTheDirection) {
  bool hit = false;
  const Wrench w = saturated(device(), {Vec3(6, 0, -8), Vec3(0, 0.1, 0)}, hit);
  EXPECT_TRUE(hit);
  EXPECT_LT((w.force - Vec3(1.8, 0, -2.4)).norm(), 1e-14);  // 3 N along (0.6, 0, −0.8)
  EXPECT_EQ(w.torque, Vec3(0, 0.1, 0));
}

TEST(Limits, WhatIsWithinTheLimitsPassesUntouched) {
  bool hit = false;
  const Wrench w{Vec3(1, -2, 2), Vec3(0.1, 0, 0)};
  EXPECT_EQ(saturated(device(), w, hit).force, w.force);
  EXPECT_EQ(slew_limited(device(), {Vec3(1, -2, 1.95), Vec3(0.1, 0, 0)}, w, 1e-3, hit).force, w.force);
  EXPECT_FALSE(hit);
}

TEST(Limits, SlewIsRateTimesPeriodAlongTheChange) {
  bool hit = false;
  const Wrench w = slew_limited(device(), {}, {Vec3(0, 2, 0), Vec3(0.2, 0, 0)}, 1e-3, hit);
  EXPECT_TRUE(hit);
  EXPECT_LT((w.force - Vec3(0, 0.1, 0)).norm(), 1e-15);    // 100 N/s · 1 ms
  EXPECT_LT((w.torque - Vec3(0.01, 0, 0)).norm(), 1e-15);  // 100 · 0.3 / 3 N·m/s · 1 ms
}

TEST(Limits, TogetherTheyHoldForAnyRequest) {
  std::mt19937 random(5);
  std::normal_distribution<double> any(0, 5);
  const DeviceSettings d = device();
  Wrench last;
  for (int i = 0; i < 20'000; ++i) {
    bool hit = false;
    const Wrench asked{Vec3(any(random), any(random), any(random)),
                       Vec3(any(random), any(random), any(random))};
    const Wrench sent = slew_limited(d, last, saturated(d, asked, hit), 1e-3, hit);
    ASSERT_LE(sent.force.norm(), d.max_force * (1 + 1e-12));
    ASSERT_LE(sent.torque.norm(), d.max_torque * (1 + 1e-12));
    ASSERT_LE((sent.force - last.force).norm(), 0.1 * (1 + 1e-12));
    last = sent;
  }
}

TEST(Limits, AbsurdButFiniteForcesAreSaturatedNotOverflown) {
  bool hit = false;
  const Wrench w = saturated(device(), {Vec3(1e300, 0, 0), Vec3::Zero()}, hit);
  EXPECT_NEAR(w.force.x(), 3, 1e-12);
  EXPECT_TRUE(is_finite(w));
}

TEST(Limits, ADeviceWithoutMaximaGetsNoForce) {
  bool hit = false;
  EXPECT_EQ(saturated(DeviceSettings{}, {Vec3(1, 1, 1), Vec3::Zero()}, hit).force, Vec3::Zero());
  EXPECT_EQ(slew_limited(DeviceSettings{}, {}, {Vec3(1, 1, 1), Vec3::Zero()}, 1e-3, hit).force, Vec3::Zero());
}

TEST(Limits, AGhostIsASpringAsTheHandFeelsItAndIsBounded) {
  DeviceSettings device;
  device.position_scale = 0.1;
  device.frame = Quat(Eigen::AngleAxisd(std::numbers::pi / 2, Vec3::UnitZ()));
  EXPECT_EQ(ghost_force(device, Vec3::Zero(), Vec3::UnitX()), Vec3::Zero());  // it has none
  device.ghost = {.of = 1, .stiffness = 100, .max_force = 0.5};
  // 0.2 mm in the scene are 2 mm of the hand; x of the scene is −y of the device.
  const Vec3 own(1, 2, 3);
  EXPECT_LT((ghost_force(device, own, own + Vec3(0.2e-3, 0, 0)) - Vec3(0, -0.2, 0)).norm(), 1e-12);
  EXPECT_LT((ghost_force(device, own, own + Vec3(1, 0, 0)) - Vec3(0, -0.5, 0)).norm(), 1e-12);
  EXPECT_EQ(ghost_force(device, own, own), Vec3::Zero());
}

TEST(Limits, AnyComponentThatIsNotFiniteIsSeen) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()})
    for (int i = 0; i < 6; ++i) {
      Wrench w;
      (i < 3 ? w.force : w.torque)[i % 3] = bad;
      EXPECT_FALSE(is_finite(w));
    }
  EXPECT_TRUE(is_finite(Wrench{}));
}

TEST(Limits, BlendGoesFromTheForceThatWasInSixEvenSteps) {
  const Wrench before{Vec3(1, 0, 0), Vec3::Zero()}, after{Vec3(0.5, 0, 0), Vec3::Zero()};
  Blend blend;
  start_blend(blend, before, 5e-3);
  const double expected[] = {11.0 / 12, 10.0 / 12, 9.0 / 12, 8.0 / 12, 7.0 / 12, 0.5, 0.5};
  for (double f : expected) EXPECT_NEAR(blended(blend, after, 1e-3).force.x(), f, 1e-12);
  EXPECT_EQ(blend.left, 0);
}

TEST(Limits, BlendGoesToTheForceThatIsFreshMeanwhile) {
  Blend blend;
  start_blend(blend, {Vec3(1, 0, 0), Vec3::Zero()}, 5e-3);
  blended(blend, {}, 1e-3);
  EXPECT_NEAR(blended(blend, {Vec3(2, 0, 0), Vec3::Zero()}, 1e-3).force.x(), 1 + 2.0 / 6, 1e-12);
}

// A short one that begins in a long one does not cut it short: half of 5 ms is longer than 2.
TEST(Limits, AShorterBlendKeepsTheTimeOfTheOneUnderWay) {
  Blend blend;
  start_blend(blend, {Vec3(1, 0, 0), Vec3::Zero()}, 5e-3);
  Wrench last;
  for (int i = 0; i < 3; ++i) last = blended(blend, {}, 1e-3);
  EXPECT_NEAR(last.force.x(), 0.5, 1e-12);
  start_blend(blend, last, 2e-3);
  EXPECT_NEAR(blend.time, 2.5e-3, 1e-12);
  EXPECT_NEAR(blended(blend, {}, 1e-3).force.x(), 0.5 * (1 - 1 / 3.5), 1e-12);
}

}  // namespace
}  // namespace hapticd
