// Two hands of one tissue in virtual time, one of them answered at an edge: what each feels of the other.
#include <gtest/gtest.h>

#include "server/files/paths.h"
#include "server/scene/scene_reader.h"
#include "server/scene/scene_world.h"
#include "server/schedule/virtual_daemon.h"

namespace hapticd {
namespace {

Scene cube_of_two() {
  Scene scene = read_scene(config_directory() / "scenes/cube/cube.yaml");
  scene.first().removal = {};
  scene.instruments.push_back(scene.first());
  for (int i = 0; i < 2; ++i)
    scene.instruments[static_cast<std::size_t>(i)].device.origin.x() = (2 * i - 1) * 6e-3;
  return scene;
}

// Both go 3 mm down in 0.4 s and stay; the second one's client ends at `gone_at`.
struct Pressed {
  std::vector<EachInstrument<ForceSample>> forces;
  std::vector<bool> second_is_there;  // for the simulation

  Pressed(const Scene& scene, const VirtualDaemonSettings& settings, int gone_at = 1 << 30) {
    HapticOptions options = haptic_options(scene);
    let_problems_grow_old(options.watchdog, 0.5);
    VirtualDaemon daemon(make_world(scene), scene.rate, devices_of(scene), options, settings);
    for (int k = 0; k < 1200; ++k) {
      HapticInput input;
      input.now_ns = VirtualDaemonSettings().first_ns + k * std::int64_t{1'000'000};
      for (int i = 0; i < 2; ++i) {
        DeviceInput& d = input.device[i];
        d.presence.connected = i == 0 || k < gone_at;
        d.presence.new_client = k == 0;
        d.taken = d.presence.connected;
        d.sample.sequence = static_cast<std::uint64_t>(k) + 1;
        d.sample.received_ns = input.now_ns;
        d.sample.pose.p = Vec3(0, 0, 26e-3 - 6e-3 * std::min(1.0, k / 400.0));
        d.sample.enable = true;
      }
      forces.push_back(daemon.tick(input));
      second_is_there.push_back(daemon.told()[1].present);
    }
  }
  const Vec3& force(int hand, std::size_t tick = 1199) const { return forces[tick][hand].force; }
};

VirtualDaemonSettings over(const LinkTrouble& link) {
  VirtualDaemonSettings settings;
  settings.link = link;
  settings.at_simulation[0] = true;
  return settings;
}

TEST(VirtualEdge, EachFeelsWhatOneDaemonOfBothMakesItFeel) {
  const Scene scene = cube_of_two();
  const Pressed whole(scene, {});
  ASSERT_GT(whole.force(0).norm(), 0.02);
  for (const LinkTrouble& link : {LinkTrouble{0, 0, 0}, LinkTrouble{20e-3, 5e-3, 0.05}}) {
    const Pressed apart(scene, over(link));
    for (const int hand : {0, 1}) {
      EXPECT_LT((apart.force(hand) - whole.force(hand)).norm(), 0.01 * whole.force(hand).norm()) << hand;
      // No force steps, whatever the network does.
      for (std::size_t k = 1; k < apart.forces.size(); ++k)
        ASSERT_LE((apart.force(hand, k) - apart.force(hand, k - 1)).norm(),
                  1e-3 * scene.instruments[0].device.max_force_rate * (1 + 1e-9));
    }
  }
}

// The trainee's hand is answered beside the simulation: the network does nothing to it by itself.
TEST(VirtualEdge, AHandBesideTheSimulationHasNoDelay) {
  const Scene scene = cube_of_two();
  const Pressed near(scene, over({0, 0, 0}), 0), far(scene, over({100e-3, 0, 0}), 0);  // nobody at the edge
  for (std::size_t k = 0; k < near.forces.size(); ++k) {
    ASSERT_EQ(near.force(0, k), far.force(0, k)) << k;
    ASSERT_FALSE(far.second_is_there[k]) << k;
    ASSERT_LE(far.forces[k][0].problem_age_ns, 31'000'000) << k;
  }
}

TEST(VirtualEdge, WhoseClientEndsAtTheEdgeLeavesTheTissueADelayLater) {
  const Scene scene = cube_of_two();
  constexpr int gone_at = 800, delay = 20;
  const Pressed both(scene, over({1e-3 * delay, 0, 0})), left(scene, over({1e-3 * delay, 0, 0}), gone_at),
      alone(scene, over({1e-3 * delay, 0, 0}), 0);
  EXPECT_TRUE(left.second_is_there[gone_at + delay - 1]);
  EXPECT_FALSE(left.second_is_there[gone_at + delay]);
  EXPECT_EQ(left.force(0, gone_at + delay - 1), both.force(0, gone_at + delay - 1));
  EXPECT_GT((both.force(0) - alone.force(0)).norm(), 0.03 * alone.force(0).norm());
  EXPECT_LT((left.force(0) - alone.force(0)).norm(), 0.01 * alone.force(0).norm());
  EXPECT_EQ(left.force(1), Vec3::Zero());
}

}  // namespace
}  // namespace hapticd
