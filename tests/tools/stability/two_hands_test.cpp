// Two hands in one tissue, in closed loops and virtual time.
#include <gtest/gtest.h>

#include "server/files/paths.h"
#include "server/scene/scene_reader.h"
#include "tools/stability/bench/two_hand_renderer.h"
#include "tools/stability/random_hands.h"

namespace hapticd {
namespace {

Scene cube_of_two(double apart) {
  Scene scene = read_scene(config_directory() / "scenes/cube/cube.yaml");
  scene.instruments.push_back(scene.first());
  scene.instruments[1].name = "second";
  scene.instruments[1].device.origin.x() += apart;
  return scene;
}

Pose down(double depth) { return {Vec3(0, 0, 26e-3 - depth), Quat::Identity()}; }

double depth_at(int tick) { return 5e-3 * std::min(1.0, tick / 400.0); }

// The other a metre away: what a hand feels is, but for round-off, what it feels by itself. A step's bits are
// the same (two_hands_test.cpp of physics), a tick's last ones are not; why is not traced.
TEST(TwoHandRenderer, WhoIsFarAwayIsNotFelt) {
  const Scene two = cube_of_two(1);
  Scene one = two;
  one.instruments.resize(1);
  TwoHandRenderer beside(two, 0, {[](double) { return down(5e-3).p; }, {}, 1e9});
  DaemonRenderer alone(one, {});
  double largest = 0, worst = 0;
  for (int k = 0; k < 600; ++k) {
    DeviceSample sample;
    sample.sequence = static_cast<std::uint64_t>(k) + 1;
    sample.pose = down(depth_at(k));
    sample.enable = true;
    const ForceSample a = beside.tick(&sample), b = alone.tick(&sample);
    largest = std::max(largest, a.force.norm());
    worst = std::max(worst, (a.force - b.force).norm());
  }
  EXPECT_GT(largest, 0.02);
  EXPECT_LT(worst, 1e-9 * largest);
  std::printf("  forces differ by %.1e of the largest\n", worst / largest);
}

// Beside another that is 2 mm deep a hand feels less; where the other's client dies, its instrument leaves
// the tissue, and what is felt becomes what one alone feels.
TEST(TwoHandRenderer, WhoseClientDiesLeavesTheTissue) {
  const Scene two = cube_of_two(10e-3);
  Scene one = two;
  one.instruments.resize(1);
  constexpr double dies = 0.9;
  const auto at = [](double t) { return down(5e-3 * std::min(1.0, t / 0.3)).p; };
  TwoHandRenderer beside(two, 0, {at, {}, 1e9}), left(two, 0, {at, {}, dies});
  DaemonRenderer alone(one, {});
  Vec3 pressed = Vec3::Zero(), after = Vec3::Zero(), by_itself = Vec3::Zero();
  for (int k = 0; k < 1600; ++k) {
    DeviceSample sample;
    sample.sequence = static_cast<std::uint64_t>(k) + 1;
    sample.pose = down(depth_at(k));
    sample.enable = true;
    pressed = beside.tick(&sample).force;
    after = left.tick(&sample).force;
    by_itself = alone.tick(&sample).force;
    if (k < 1e3 * dies) {
      EXPECT_EQ(after, pressed);
    }
  }
  EXPECT_LT(pressed.z(), 0.97 * by_itself.z());
  EXPECT_NEAR(after.z(), by_itself.z(), 0.005 * by_itself.z());
}

// Two hands at random in the lens for sixteen seconds; a million ticks of `haptic stability --mode "random
// two"`.
TEST(TwoHandsAtRandom, NothingBurstsAndTwoMakeNoMoreEnergyThanOne) {
  const Scene scene = read_scene(config_directory() / "scenes/two_hands/two_hands.yaml");
  RandomSettings settings;
  settings.ticks = 16'000;
  settings.episode = 8'000;
  const auto on = [](double) { return true; };
  const RandomReport two = run_random(scene, lens_hands(2), settings, on),
                     one = run_random(scene, lens_hands(1), settings, on);
  for (const RandomReport* r : {&two, &one})
    for (const std::string& fault : r->faults) ADD_FAILURE() << r->hands << " hands, " << fault;
  EXPECT_EQ(two.ticks, settings.ticks);
  EXPECT_GT(two.both_in_contact, 500);
  EXPECT_GT(two.removed, 10);
  EXPECT_LE(two.force_max, two.device_max * (1 + 1e-9));
  std::printf("  made %.4f mJ by two hands, %.4f mJ by one\n", 1e3 * two.made, 1e3 * one.made);
}

TEST(TwoHandsAtRandom, BearStepsThatAreLate) {
  RandomSettings settings;
  settings.ticks = 16'000;
  settings.episode = 8'000;
  settings.seed = 11;
  settings.late_steps = 1;
  const RandomReport r = run_random(read_scene(config_directory() / "scenes/two_hands/two_hands.yaml"),
                                    lens_hands(2), settings, [](double) { return true; });
  for (const std::string& fault : r.faults) ADD_FAILURE() << fault;
  EXPECT_EQ(r.ticks, settings.ticks);
  EXPECT_LT(r.steps, 0.95 * static_cast<double>(r.ticks) / 20);
  EXPECT_GT(r.both_in_contact, 500);
  EXPECT_GT(r.removed, 10);
  EXPECT_LE(r.force_max, r.device_max * (1 + 1e-9));
}

}  // namespace
}  // namespace hapticd
