// A hand whose device another process answers: there while it is told of, and never a jump.
#include "server/edge/remote_hand.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

struct RemoteHand : testing::Test {
  Channel<InstrumentInputs> told;
  RemoteHands hands{told};
  DeviceSettings device;
  std::int64_t now = 1000 * ms;
  DeviceSample sample;

  RemoteHand() {
    device.max_speed = 2;
    device.position_scale = 0.5;
    device.origin = Vec3(1, 2, 3);
    device.frame = Quat(Eigen::AngleAxisd(1, Vec3::UnitX()));
    device.pivot.emplace();
    device.ghost.emplace();
  }
  void tell(const Vec3& p, bool present = true) {
    InstrumentInput& in = told.back()[1];
    in = {};
    in.present = present;
    in.X.p = p;
    in.buttons = pedal_phaco;
    told.publish();
  }
};

TEST_F(RemoteHand, IsADeviceWhoseFrameIsTheScene) {
  const DeviceSettings scene = in_scene(device);
  const Pose X{Vec3(0.1, -0.2, 0.3), Quat(Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()))};
  const Pose there = to_scene(scene, X);
  EXPECT_EQ(there.p, X.p);
  EXPECT_LT(there.q.angularDistance(X.q), 1e-12);
  EXPECT_EQ(scene.max_speed, 1);
  EXPECT_FALSE(scene.ghost);
  EXPECT_FALSE(scene.pivot);
}

TEST_F(RemoteHand, IsThereWhileItIsToldOfAndANewClientEachTimeItComes) {
  RemotePort port(hands, 1, in_scene(device));
  EXPECT_FALSE(port.take(now, sample));
  EXPECT_FALSE(port.presence().connected);
  for (int round = 0; round < 2; ++round) {
    tell(Vec3(1, 0, 0));
    ASSERT_TRUE(port.take(now += ms, sample));
    EXPECT_TRUE(port.presence().connected && port.presence().new_client);
    EXPECT_TRUE(sample.enable);
    EXPECT_EQ(sample.buttons, std::uint32_t{pedal_phaco});
    EXPECT_EQ(sample.pose.p, Vec3(1, 0, 0));
    const std::uint64_t number = sample.sequence;
    ASSERT_TRUE(port.take(now += 59 * ms, sample));  // a network's silence
    EXPECT_FALSE(port.presence().new_client);
    EXPECT_GT(sample.sequence, number);
    EXPECT_EQ(sample.received_ns, now);
    EXPECT_FALSE(port.take(now += ms, sample));
    EXPECT_FALSE(port.presence().connected);
  }
  tell(Vec3(1, 0, 0));
  EXPECT_TRUE(port.take(now += ms, sample));
  tell(Vec3(1, 0, 0), false);  // told that nobody is there
  EXPECT_FALSE(port.take(now += ms, sample));
}

// The network holds a hand up and lets it go: what the loop sees is a hand that hurries.
TEST_F(RemoteHand, GoesAfterAJumpAsFastAsItsDeviceMay) {
  const DeviceSettings scene = in_scene(device);
  RemotePort port(hands, 1, scene);
  tell(Vec3::Zero());
  ASSERT_TRUE(port.take(now, sample));
  const Vec3 far(0.02, 0, 0);
  int ticks = 0;
  for (; sample.pose.p != far && ticks < 100; ++ticks) {
    const DeviceSample before = sample;
    tell(far);
    ASSERT_TRUE(port.take(now += ms, sample));
    EXPECT_LE((sample.pose.p - before.pose.p).norm(), 1e-3 * scene.max_speed);
    EXPECT_EQ(check_sample(scene, sample, &before, ms, 1e-3), Refusal::none);
  }
  EXPECT_EQ(ticks, 23);  // 20 mm at 0.9 m/s
}

}  // namespace
}  // namespace hapticd
