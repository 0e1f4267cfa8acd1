#include "haptic/pivot.h"

#include <gtest/gtest.h>

#include <random>

#include "haptic/limits.h"

namespace hapticd {
namespace {

class RandomPivot {
 public:
  explicit RandomPivot(unsigned seed) : random_(seed) {}

  Vec3 vector(double size) { return size * Vec3(normal_(random_), normal_(random_), normal_(random_)); }
  Pose stylus(double size) {
    const Vec3 turn = vector(1);
    return {vector(size), Quat(Eigen::AngleAxisd(turn.norm(), turn.normalized()))};
  }
  Pivot pivot() { return {vector(3e-3), vector(1).normalized()}; }

 private:
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

double depth(const Pivot& pivot, const Vec3& tip) { return (pivot.point - tip).dot(pivot.axis); }

// A turn by the least angle: a stylus that passes through the point already is left as it is.
TEST(Pivot, TheShaftPassesThroughThePoint) {
  RandomPivot random(1);
  int inside = 0;
  for (int i = 0; i < 10'000; ++i) {
    const Pivot pivot = random.pivot();
    const Pose stylus = random.stylus(8e-3), X = through_pivot(pivot, stylus);
    ASSERT_EQ(X.p, stylus.p);
    const Vec3 shaft = X.q * Vec3::UnitZ(), stylus_axis = stylus.q * Vec3::UnitZ();
    const Quat turn = X.q * stylus.q.conjugate();
    ASSERT_NEAR(2 * std::acos(std::min(1.0, std::abs(turn.w()))),
                std::acos(std::clamp(shaft.dot(stylus_axis), -1.0, 1.0)), 1e-6);
    if (depth(pivot, X.p) < 1e-3) continue;
    ++inside;
    const Vec3 v = pivot.point - X.p;
    ASSERT_LT((v - shaft * shaft.dot(v)).norm(), 1e-12);
    ASSERT_GT(shaft.dot(v), 0);
    ASSERT_LT(difference(through_pivot(pivot, X), X).norm(), 1e-12);
  }
  EXPECT_GT(inside, 2'000);
}

// What the hand does is done at the instrument: f·δp + τ·δθ is the same at both ends, for any small motion of
// the stylus, inside, near the point and beyond it.
TEST(Pivot, WorkIsTheSameAtBothEnds) {
  RandomPivot random(2);
  const double step = 1e-7;
  int raised = 0;
  for (int i = 0; i < 10'000; ++i) {
    const Pivot pivot = random.pivot();
    const Pose stylus = random.stylus(8e-3);
    if (std::abs(depth(pivot, stylus.p) - 1e-3) < 1e-5) continue;  // the kink
    const Pose X = through_pivot(pivot, stylus);
    if ((X.q * Vec3::UnitZ()).dot(stylus.q * Vec3::UnitZ()) < -0.9)
      continue;  // derivatives grow as 1/(1 + z·u)
    raised += depth(pivot, stylus.p) < 1e-3;
    Vec6 wrench, motion;
    wrench << random.vector(1), random.vector(5e-3);
    motion << random.vector(step * 5e-3), random.vector(step);
    const Vec6 minus = difference(through_pivot(pivot, displaced(stylus, -motion)), X);
    const Vec6 moved = 0.5 * (difference(through_pivot(pivot, displaced(stylus, motion)), X) - minus);
    ASSERT_NEAR(on_stylus(pivot, stylus, wrench).dot(motion), wrench.dot(moved), 1e-6 * step) << i;
  }
  EXPECT_GT(raised, 2'000);
}

// A force at the point itself is felt along the shaft only: the point is held, not the hand.
TEST(Pivot, WhatHoldsThePointIsNotFeltAcrossTheShaft) {
  const Pivot pivot{Vec3(0, 0, 8e-3), Vec3::UnitZ()};
  const Pose stylus{Vec3::Zero(), Quat(Eigen::AngleAxisd(0.7, Vec3::UnitX()))};
  const Vec3 push(0.2, -0.1, 0.3);
  Vec6 wrench;
  wrench << push, pivot.point.cross(push);
  const Vec6 felt = on_stylus(pivot, stylus, wrench);
  EXPECT_LT((felt.head<3>() - Vec3(0, 0, 0.3)).norm(), 1e-15);
  EXPECT_LT(felt.tail<3>().norm(), 1e-15);
}

// Beyond the point and against the shaft: a direction there is, and numbers stay finite and steady.
TEST(Pivot, ATipThatIsDrawnOutKeepsPointingIn) {
  const Pivot pivot{Vec3(0, 0, 8e-3), Vec3::UnitZ()};
  Vec3 before = Vec3::Zero();
  for (int i = 0; i <= 2'000; ++i) {
    const Pose X = through_pivot(pivot, {Vec3(0.5e-3, 0, 10e-6 * i), Quat::Identity()});
    const Vec3 shaft = X.q * Vec3::UnitZ();
    ASSERT_GT(shaft.z(), 0.8);
    if (i > 0) {
      ASSERT_LT((shaft - before).norm(), 5e-3);
    }
    before = shaft;
  }
  const Pose against{Vec3::Zero(), Quat(0, 1, 0, 0)};  // z down
  const Pose X = through_pivot(pivot, against);
  EXPECT_LT((X.q * Vec3::UnitZ() - Vec3::UnitZ()).norm(), 1e-12);
  EXPECT_TRUE(on_stylus(pivot, against, Vec6::Ones()).allFinite());
}

TEST(Pivot, ADeviceWithoutOneIsMappedAsBefore) {
  RandomPivot random(3);
  DeviceSettings device;
  device.position_scale = 0.08;
  device.force_scale = 100;
  device.frame = Quat(Eigen::AngleAxisd(0.3, Vec3::UnitY()));
  const Pose pose = random.stylus(0.05);
  EXPECT_EQ(to_scene(device, pose).q.coeffs(), stylus_in_scene(device, pose).q.coeffs());
  const Wrench felt = wrench_on_device(device, pose, Vec6::Ones());
  EXPECT_LT((felt.force - 100 * (device.frame.conjugate() * Vec3::Ones())).norm(), 1e-12);
  EXPECT_LT((felt.torque - 1250 * (device.frame.conjugate() * Vec3::Ones())).norm(), 1e-9);
}

}  // namespace
}  // namespace hapticd
