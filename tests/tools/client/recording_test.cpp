#include "tools/client/recording.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

Trajectory some() {
  std::vector<TrajectorySample> samples;
  for (int i = 0; i < 5; ++i) {
    Pose pose;
    pose.p = Vec3(0.01 * i, 0.02, 0.001 * i * i);
    pose.q = Quat(Eigen::AngleAxisd(0.1 * i, Vec3(1, 2, 3).normalized()));
    samples.push_back({0.1 * i, pose, unsigned(i % 2)});
  }
  return make_trajectory(std::move(samples));
}

TEST(Recording, CentringPutsTheMeanAtTheOriginAndKeepsTheShape) {
  const Trajectory before = some(), after = centred(before);
  Vec3 mean = Vec3::Zero();
  for (const TrajectorySample& s : after.samples) mean += s.pose.p;
  EXPECT_LT(mean.norm(), 1e-15);
  const Vec3 offset = after.samples[0].pose.p - before.samples[0].pose.p;
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_LT((after.samples[i].pose.p - before.samples[i].pose.p - offset).norm(), 1e-15);
    EXPECT_EQ(after.samples[i].buttons, before.samples[i].buttons);
  }
}

// The device's map takes the result back to the scene.
TEST(Recording, FromSceneInvertsTheDevicesMap) {
  DeviceSettings device;
  device.position_scale = 0.1;
  device.origin = Vec3(0.001, -0.002, 0.003);
  device.frame = Quat(Eigen::AngleAxisd(0.7, Vec3(1, 1, 0).normalized()));
  device.tool = Quat(Eigen::AngleAxisd(-1.1, Vec3(0, 1, 2).normalized()));
  const Trajectory scene = some(), on_device = from_scene(device, scene);
  for (std::size_t i = 0; i < 5; ++i)
    EXPECT_LT(difference(to_scene(device, on_device.samples[i].pose), scene.samples[i].pose).norm(), 1e-14);
}

TEST(Recording, LargestSpeedScales) {
  const double speed = largest_speed(some());
  EXPECT_NEAR(speed, Vec3(0.01, 0, 0.007).norm() / 0.1, 1e-12);
  EXPECT_NEAR(largest_speed(scaled(some(), 3)), 3 * speed, 1e-12);
  EXPECT_THROW(scaled(some(), 0), std::invalid_argument);
}

}  // namespace
}  // namespace hapticd
