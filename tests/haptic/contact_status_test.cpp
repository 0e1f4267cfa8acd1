// What a force sample says of contacts that are not held: lost, and dropped.
#include <gtest/gtest.h>

#include <memory>

#include "haptic/haptic_step.h"
#include "tests/haptic/wall.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

// A device that holds still over the wall, at a scale of 1.
struct ContactStatus : testing::Test {
  DeviceSettings device;
  Instrument instrument = wall::instrument();
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  HapticOptions options;
  std::unique_ptr<HapticState> state = std::make_unique<HapticState>();

  ContactStatus() {
    device.max_force = 3;
    device.max_torque = 0.1;
    device.max_force_rate = 1e4;
    device.max_speed = 1;
    device.damping = 4;
    wall::make(*problem, 1, 0);
  }
  // The last of as many ticks as the ramp takes, with the tip's centre at this height.
  ForceSample at(double height, int ticks = 121) {
    ForceSample sample;
    for (int k = 1; k <= ticks; ++k) {
      HapticInput in;
      in.now_ns = problem->published_ns = (1000 + k) * ms;
      in.device[0].presence.connected = true;
      in.device[0].presence.new_client = k == 1;
      in.device[0].taken = true;
      in.device[0].sample.sequence = k;
      in.device[0].sample.received_ns = in.now_ns;
      in.device[0].sample.enable = true;
      in.device[0].sample.pose.p = Vec3(0, 0, height);
      sample = haptic_step(problem.get(), instrument, device, options, in, *state);
    }
    return sample;
  }
  // side × side samples in a square of 0.4 mm, which a tip 0.2 mm deep covers.
  void wall_of(int side) {
    const PatchSample first = problem->sample[0];
    problem->samples = side * side;
    for (int k = 0; k < side * side; ++k) {
      problem->sample[k] = first;
      problem->sample[k].id = k + 1;
      problem->sample[k].free =
          0.4e-3 * Vec3(k / side / (side - 1.0) - 0.5, k % side / (side - 1.0) - 0.5, 0);
    }
  }
};

// From below the wall's sample shows its inner side: it is no row, whatever its overlap.
TEST_F(ContactStatus, LostWhereASampleDeepInsideHasNoRow) {
  const ForceSample f = at(-wall::radius + 0.2e-3);
  EXPECT_EQ(f.status, status_contact_lost);
  EXPECT_EQ(f.contacts, 0u);
  EXPECT_EQ(f.force, Vec3::Zero());
  EXPECT_NEAR(f.penetration, 0.2e-3, 1e-12);
}

TEST_F(ContactStatus, NotLostWithinATenthOfAMillimetre) {
  const ForceSample f = at(-wall::radius + 0.05e-3);
  EXPECT_EQ(f.status, 0u);
  EXPECT_NEAR(f.penetration, 0.05e-3, 1e-12);
}

// From above the same overlap of the free wall is held by a row.
TEST_F(ContactStatus, NotLostWhereARowHoldsTheSample) {
  const ForceSample f = at(wall::radius - 0.2e-3);
  EXPECT_EQ(f.status, 0u);
  EXPECT_EQ(f.active, 1u);
}

// In the tick in which the tip is there: by the next one the contacts have pushed it out.
TEST_F(ContactStatus, DroppedWhereMoreSamplesOverlapThanContactsFit) {
  wall_of(11);
  options.contact.linearisations = 1;
  const ForceSample f = at(wall::radius - 0.2e-3, 1);
  EXPECT_TRUE(f.status & status_contacts_dropped);
  EXPECT_EQ(f.contacts, unsigned(max_contacts));
  EXPECT_EQ(f.dropped, 121u - max_contacts);
}

TEST_F(ContactStatus, NothingDroppedWhereAllFit) {
  wall_of(10);
  options.contact.linearisations = 1;
  const ForceSample f = at(wall::radius - 0.2e-3, 1);
  EXPECT_FALSE(f.status & status_contacts_dropped);
  EXPECT_EQ(f.contacts, 100u);
  EXPECT_EQ(f.dropped, 0u);
}

// The simulation says so of samples that did not fit the patch.
TEST_F(ContactStatus, DroppedWhereThePatchWasTooSmall) {
  problem->dropped_samples = 1;
  const ForceSample f = at(wall::radius - 0.2e-3);
  EXPECT_EQ(f.status, status_contacts_dropped);
  EXPECT_EQ(f.samples_dropped, 1u);
  EXPECT_EQ(f.samples, static_cast<std::uint32_t>(problem->samples));
  EXPECT_EQ(f.dropped, 0u);
}

}  // namespace
}  // namespace hapticd
