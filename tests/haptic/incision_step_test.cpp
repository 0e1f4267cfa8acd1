// An incision in the haptic loop: it makes no energy, keeps a pivoted shaft where it is, and costs little.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <random>

#include "haptic/haptic_step.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr double depth = 6e-3;

struct IncisionStep : testing::Test {
  Instrument instrument;
  DeviceSettings device;
  HapticOptions options;
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  std::unique_ptr<HapticState> state = std::make_unique<HapticState>();
  std::int64_t now = 1000 * ms;
  std::uint64_t sequence = 0;
  Pose pose;

  IncisionStep() {
    Primitive rod;
    rod.shape = Shape::capsule;
    rod.radius = 0.4e-3;
    rod.half_length = 20e-3;
    rod.placement.p = Vec3(0, 0, 20e-3);
    instrument.primitives = {rod};
    instrument.incision = {Vec3(0, 0, depth), Vec3::UnitZ(), 0.05e-3, 1500, 0.3};
    device.max_force = 10;
    device.max_torque = 10;
    device.max_force_rate = 1e5;
    device.max_speed = 1;
    problem->step = 1;
    problem->renewal = Renewal::renewed;
    problem->alarm_distance = 0.5e-3;
    problem->instrument[0].coupling = {
        .stiffness = 50, .rotational_stiffness = 1.25e-3, .damping_time = 2e-3};
  }
  ForceSample tick() {
    now += ms;
    problem->published_ns = now;
    HapticInput in;
    in.now_ns = now;
    DeviceInput& d = in.device[0];
    d.presence.connected = true;
    d.presence.new_client = sequence == 0;
    d.taken = true;
    d.sample.sequence = ++sequence;
    d.sample.received_ns = now;
    d.sample.enable = true;
    d.sample.pose = pose;
    return haptic_step(problem.get(), instrument, device, options, in, *state);
  }
  // As far from the ring's middle as the shaft's axis is, of the proxy.
  double offset() const {
    const Pose& X = state->solution.instrument[0];
    const Vec3 z = X.q * Vec3::UnitZ(), v = X.p - instrument.incision.at;
    return (v - z * z.dot(v)).norm();
  }
};

// A hand that goes at random, tip by up to 1 mm and shaft by up to 0.15 rad, both along and about the shaft:
// it never has more energy back than it gave.
TEST_F(IncisionStep, MakesNoEnergyInRandomTicks) {
  for (int i = 0; i < 200; ++i) tick();
  std::mt19937 random(17);
  std::normal_distribution<double> normal(0, 1);
  Vec6 place = Vec6::Zero(), speed = Vec6::Zero();
  double least = 0, most = 0, strongest = 0;
  for (int i = 0; i < 100'000; ++i) {
    for (int c = 0; c < 6; ++c) {
      const double reach = c < 3 ? 1e-3 : 0.15;
      speed[c] += reach * (1.5e-3 * normal(random)) - 2e-4 * place[c] - 0.02 * speed[c];
      place[c] += speed[c];
    }
    pose = displaced(Pose{}, place);
    const ForceSample answer = tick();
    ASSERT_FALSE(answer.status &
                 (status_rejected | status_saturated | status_not_finite | status_slew_limited))
        << answer.status;
    least = std::min(least, answer.energy);
    most = std::max(most, answer.energy);
    strongest = std::max(strongest, answer.force.norm());
  }
  std::printf("energy of the hand: least %.3g J, most %.3g J, force to %.3g N\n", least, most, strongest);
  EXPECT_GT(strongest, 5e-3);
  EXPECT_GT(most, 1e-5);
  EXPECT_GE(least, -1e-9 * most);
}

// A shaft turned through the same point by its pivot: whatever pushes its tip, its axis stays in the ring.
TEST_F(IncisionStep, WithAPivotTheAxisStaysWithin50Micrometres) {
  device.pivot = Pivot{instrument.incision.at, instrument.incision.axis};
  problem->samples = 1;  // a wall that the tip is pressed against
  problem->sample[0] = {1, {-1, -1, -1}, {1, 0, 0}, Vec3(0.4e-3, 0, 0), -Vec3::UnitX(), 0};
  instrument.incision.slack = 0.02e-3;
  double farthest = 0, strongest = 0;
  for (int i = 0; i < 6000; ++i) {
    pose.p =
        Vec3(0.15e-3 * (1 - std::cos(1e-3 * i)), 0.2e-3 * std::sin(3e-3 * i), 0.1e-3 * std::sin(5e-3 * i));
    const ForceSample answer = tick();
    farthest = std::max(farthest, offset());
    strongest = std::max(strongest, answer.force.norm());
  }
  EXPECT_GT(strongest, 5e-3);
  EXPECT_LT(farthest, 50e-6);
}

// Against the same ticks without one. Printed; the bound is wide, for machines that are busy.
TEST_F(IncisionStep, CostsAFewMicrosecondsATick) {
  const auto median = [&](double stiffness) {
    instrument.incision.stiffness = stiffness;
    std::vector<double> us;
    for (int i = 0; i < 4000; ++i) {
      pose.p = Vec3(0.2e-3 * std::sin(0.01 * i), 0.2e-3 * std::cos(0.013 * i), 1e-3 * std::sin(0.02 * i));
      const auto begin = std::chrono::steady_clock::now();
      tick();
      us.push_back(1e6 * std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
    }
    std::sort(us.begin() + 500, us.end());
    return us[2250];
  };
  const double without = median(0), with = median(1500);
  std::printf("a tick of %.2f us without incision, %.2f us with one\n", without, with);
  EXPECT_LT(with - without, 100);
}

}  // namespace
}  // namespace hapticd
