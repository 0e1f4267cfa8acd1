// The shipped scene in which a fragment of the lens settles in the capsule under gravity.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <numbers>

#include "server/scene/scene_reader.h"
#include "server/scene/scene_world.h"
#include "tests/support/bodies.h"

namespace hapticd {
namespace {

std::unique_ptr<World> fragment_world() {
  return make_world(read_scene(std::filesystem::path(SOURCE_DIR) / "config/scenes/fragment/fragment.yaml"));
}

// Once as it is, and once with the tip hovering within the alarm distance, so that nothing may sleep.
TEST(FragmentScene, SettlesWithoutJitterAndWithoutPenetration) {
  auto problem = std::make_unique<CondensedProblem>();
  for (const bool awake : {false, true}) {
    const auto world = fragment_world();
    const Body &fragment = world->bodies()[0], &capsule = world->bodies()[1];
    double deepest = 0, deepest_capsule = 0, late_speed = 0, seen = 0;
    int touched = -1, fewest_awake = 2;
    Vec3 at_two = Vec3::Zero();
    for (int i = 0; i < 150; ++i) {
      const Vec3 top = centre_of(fragment) + Vec3(0, 0, 2.3e-3);
      const StepReport r = world->step([&] { return awake ? at(top) : nobody(); }, *problem);
      EXPECT_EQ(r.contact.active, 0);
      EXPECT_EQ(r.body_contact.dropped, 0);
      EXPECT_EQ(r.body_contact.status, SolveStatus::solved) << r.body_contact.residual;
      if (touched < 0 && r.body_contact.active > 0) touched = i;
      seen = std::max(seen, r.body_contact.penetration);
      if (i == 100) at_two = centre_of(fragment);
      if (i >= 100) {
        late_speed = std::max({late_speed, fastest_node(fragment), fastest_node(capsule)});
        fewest_awake = std::min(fewest_awake, r.awake_bodies);
      }
      if (i > 30 && i % 10 != 0) continue;
      deepest = std::max(deepest, deepest_inside(fragment, capsule));
      deepest_capsule = std::max(deepest_capsule, deepest_inside(capsule, fragment));
    }
    const double drift = (centre_of(fragment) - at_two).norm();
    std::printf(
        "  %s: touches at step %d; from 2 s to 3 s fastest node %.1e m/s, centre moved %.1e m; deepest node "
        "of the fragment %.2e m, of the capsule %.1e m (reported %.2e)\n",
        awake ? "kept awake" : "may sleep", touched, late_speed, drift, deepest, deepest_capsule, seen);
    EXPECT_GE(touched, 0);
    EXPECT_LT(late_speed, 1e-5);
    EXPECT_LT(drift, 1e-8);
    EXPECT_LE(deepest, 10e-6);
    EXPECT_LE(deepest_capsule, 10e-6);
    EXPECT_EQ(fewest_awake, awake ? 2 : 0);
  }
}

// The tip goes down on the fragment twice and drags it about: some two hundred contacts within reach.
TEST(FragmentScene, PressedByTheTipEveryStepIsSolved) {
  auto problem = std::make_unique<CondensedProblem>();
  const auto world = fragment_world();
  for (int i = 0; i < 60; ++i) world->step(nobody, *problem);
  const Vec3 centre = centre_of(world->bodies()[0]);
  constexpr int steps = 150;
  std::vector<double> ms;
  int most = 0;
  for (int i = 0; i < steps; ++i) {
    const double s = 2 * std::numbers::pi * i / steps;
    const Vec3 p(0.4e-3 * std::sin(3 * s), 0.3e-3 * std::sin(2 * s), 2.5e-3 - 1.1e-3 * (1 - std::cos(2 * s)));
    const auto begun = std::chrono::steady_clock::now();
    const StepReport r = world->step([&] { return at(centre + p); }, *problem);
    ms.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count());
    EXPECT_EQ(r.body_contact.status, SolveStatus::solved) << i << ": " << r.body_contact.residual;
    most = std::max(most, r.body_contact.contacts);
  }
  std::sort(ms.begin(), ms.end());
  std::printf("  to %d contacts: step %.1f ms p50, %.1f p99, %.1f at most\n", most, ms[steps / 2],
              ms[steps * 99 / 100], ms.back());
  EXPECT_GT(most, 100);
}

}  // namespace
}  // namespace hapticd
