#include "haptic/sample_check.h"

#include <limits>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

struct SampleCheck : testing::Test {
  DeviceSettings device;
  DeviceSample last, next;
  SampleCheck() {
    device.max_speed = 2;  // 2 mm in a millisecond
    last.sequence = 10;
    last.received_ns = 100 * ms;
    last.enable = true;
    next = last;
    next.sequence = 11;
    next.received_ns = 101 * ms;
  }
  Refusal check() const { return check_sample(device, next, &last, ms, 1e-3); }
};

TEST_F(SampleCheck, AnOrdinarySampleIsAccepted) { EXPECT_EQ(check(), Refusal::none); }

TEST_F(SampleCheck, NotFiniteInAnyComponent) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    for (int i = 0; i < 3; ++i) {
      const DeviceSample good = next;
      next.pose.p[i] = bad;
      EXPECT_EQ(check(), Refusal::not_finite);
      next = good;
    }
    for (int i = 0; i < 4; ++i) {
      const DeviceSample good = next;
      next.pose.q.coeffs()[i] = bad;
      EXPECT_EQ(check(), Refusal::not_finite);
      next = good;
    }
  }
}

TEST_F(SampleCheck, QuaternionMustBeUnitWithinTolerance) {
  next.pose.q = Quat(1.0005, 0, 0, 0);
  EXPECT_EQ(check(), Refusal::none);
  next.pose.q = Quat(1.01, 0, 0, 0);
  EXPECT_EQ(check(), Refusal::not_unit_quaternion);
  next.pose.q = Quat(0, 0, 0, 0);
  EXPECT_EQ(check(), Refusal::not_unit_quaternion);
  next.pose.q = Quat(1e200, 1e200, 0, 0);  // its squared norm overflows
  EXPECT_EQ(check(), Refusal::not_unit_quaternion);
}

TEST_F(SampleCheck, SequenceMustRise) {
  for (std::uint64_t sequence : {10u, 9u, 0u}) {
    next.sequence = sequence;
    EXPECT_EQ(check(), Refusal::sequence_not_rising);
  }
  EXPECT_EQ(check_sample(device, next, nullptr, ms, 1e-3), Refusal::none);  // a first one may be any
}

TEST_F(SampleCheck, JumpIsSpeedTimesTime) {
  next.pose.p.x() = 1.99e-3;
  EXPECT_EQ(check(), Refusal::none);
  next.pose.p.x() = 2.01e-3;
  EXPECT_EQ(check(), Refusal::jump);
  next.received_ns = 102 * ms;  // twice the time, twice the way
  EXPECT_EQ(check(), Refusal::none);
  next.received_ns = 100 * ms;  // two in one tick count as a period apart
  EXPECT_EQ(check(), Refusal::jump);
  next.pose.p.x() = 1.99e-3;
  EXPECT_EQ(check(), Refusal::none);
}

TEST_F(SampleCheck, WithoutEnableAJumpIsNoFault) {
  next.pose.p.x() = 1;
  next.enable = false;
  EXPECT_EQ(check(), Refusal::none);
}

}  // namespace
}  // namespace hapticd
