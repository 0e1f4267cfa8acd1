#include "tools/client/hand_source.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

HandScript standing() {
  return {[](double) { return HandTarget{}; }, [](double) { return DeviceCommand{}; }};
}

// Against a wall spring K the hand's target at 0 and the wall's rest at −d meet at x = −K d / (K + k).
TEST(HandSource, SettlesWhereHandAndSpringBalance) {
  HandSettings hand;
  HandSource source(hand, standing(), 10);
  const double wall = 200, rest = -0.01;
  NewestForce force;
  for (std::int64_t k = 0; k < 3000; ++k) {
    const DeviceCommand command = source.at(k, k * 1'000'000, force, k > 0);
    force = {Vec3(0, 0, -wall * (command.pose.p.z() - rest)), k * 1'000'000 + 600'000};
  }
  EXPECT_NEAR(source.state().x.z(), wall * rest / (wall + hand.stiffness), 1e-6);
  EXPECT_NEAR(source.figures().force_max, wall * 0.01, 0.1);
}

// A slot that the client slept through costs a message and no time.
TEST(HandSource, SkippedSlotsAreIntegratedAllTheSame) {
  HandSettings hand;
  HandSource all(hand, standing(), 10), some(hand, standing(), 10);
  const NewestForce force{Vec3(1, 0, 0), 1};
  DeviceCommand a, b;
  for (std::int64_t k = 0; k <= 100; ++k) a = all.at(k, k * 1'000'000 + 5, force, k == 0);
  for (const std::int64_t k : {0, 1, 60, 61, 100}) b = some.at(k, k * 1'000'000 + 5, force, k == 0);
  EXPECT_EQ(a.pose.p, b.pose.p);
  EXPECT_GT(a.pose.p.x(), 0);
  EXPECT_EQ(all.figures().substeps, 1000);
}

TEST(HandSource, SendsWhatTheEncoderReads) {
  HandSettings hand;
  hand.quantum = 1e-3;
  HandSource source(hand, standing(), 4);
  const NewestForce force{Vec3(0.5, 0, 0), 1};
  for (std::int64_t k = 0; k <= 2000; ++k) source.at(k, k * 1'000'000 + 5, force, k == 0);
  EXPECT_NEAR(source.state().x.x(), 0.5 / 300, 1e-6);
  EXPECT_EQ(source.at(2000, 0, force, false).pose.p.x(), 0.002);
}

}  // namespace
}  // namespace hapticd
