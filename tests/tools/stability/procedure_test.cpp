// Hands that operate: what the bench of those modes counts, by hand and against another renderer.
#include "tools/stability/bench/procedure.h"

#include <gtest/gtest.h>

#include <numbers>

#include "server/files/paths.h"
#include "server/scene/scene_reader.h"
#include "tools/offline/renderer.h"
#include "tools/stability/bench/hands_daemon.h"

namespace hapticd {
namespace {

Scene cube() { return read_scene(config_directory() / "scenes/cube/cube.yaml"); }

// The force held for a step, of one of several hands, is what the renderer of one has, bit for bit.
TEST(HandsDaemon, HoldsTheForceOfAStepAsTheRendererOfOneHand) {
  HandsDaemonSettings settings;
  settings.rendering = Rendering::held;
  HandsDaemon hands(cube(), settings);
  DaemonRendererOptions options;
  options.rendering = Rendering::held;
  DaemonRenderer one(cube(), options);
  EachInstrument<bool> connected;
  connected[0] = true;
  double largest = 0;
  for (int k = 0; k < 500; ++k) {
    DeviceSample sample;
    sample.sequence = static_cast<std::uint64_t>(k) + 1;
    sample.pose = {Vec3(0, 0, 26e-3 - 5e-3 * std::min(1.0, k / 400.0)), Quat::Identity()};
    sample.enable = true;
    const Vec3 a = hands.tick({&sample}, connected)[0].force, b = one.tick(&sample).force;
    ASSERT_EQ(a, b) << k;
    largest = std::max(largest, a.norm());
  }
  EXPECT_GT(largest, 0.02);
}

// A needle whose port lies on the cube, lifted off slowly by a hand that no force moves.
struct LiftedNeedle : testing::Test {
  static constexpr double vacuum = 1000, port_radius = 2e-3, scale = 1e-3, lifted = 4e-3;
  const double area = std::numbers::pi * port_radius * port_radius;

  Procedure procedure() const {
    Procedure p;
    p.scene = cube();
    p.scene.sample_spacing = 0.7e-3;
    SceneInstrument& held = p.scene.first();
    Primitive needle;
    needle.shape = Shape::cylinder;
    needle.radius = 3e-3;
    needle.half_length = 20e-3;
    needle.placement.p = Vec3(0, 0, needle.half_length);
    held.shape = {};
    held.shape.primitives = {needle};
    held.shape.port = {Vec3::Zero(), -Vec3::UnitZ(), port_radius, 1e-3, vacuum, 0.02};
    held.device.force_scale = scale;
    p.hands = {{[](double t) {
                  return Vec3(0, 0,
                              21e-3 - 1.2e-3 * smooth_step(t / 0.4) + lifted * smooth_step((t - 0.8) / 2));
                },
                [](double t) { return t > 0.5 && t < 3.1 ? pedal_aspiration : 0u; }}};
    p.duration = 3.4;
    p.rests = {{0.7, 0.8}, {3.2, 3.4}};
    return p;
  }
};

// It is drawn with p A and no more; the hand pays for what it lifts, and with the pump's work makes nothing.
TEST_F(LiftedNeedle, IsPulledWithPressureTimesAreaAndMakesNoEnergy) {
  const ProcedureResult r = run_procedure(procedure(), Rendering::solved);
  EXPECT_TRUE(r.finite);
  EXPECT_NEAR(r.pull, 1, 0.02);
  EXPECT_LE(r.made, 1e-9 * scale);
  EXPECT_LT(r.swing, 0.1e-6);
  // The pump gave and took back: no more than p A over what the tissue was lifted by, the port's reach beside
  // it.
  EXPECT_LT(std::abs(r.pumped), scale * vacuum * area * 2e-3);
  EXPECT_GT(r.absorbed + r.pumped, 0);
  // Tissue that is drawn up by p A and let go: half of p A · u, u how far it had come.
  const double u = vacuum * area / 38;
  EXPECT_LT(r.absorbed + r.pumped, scale * vacuum * area * (u + 1e-3));
}

// A swing, a force and a change that are beyond their bounds are told by their names.
TEST(Procedure, IsJudgedByItsWorstBound) {
  ProcedureResult r;
  r.tally.device_max = 3.3;
  r.tally.farthest_allowed = r.tally.fastest_allowed = 1;
  r.swing = 10e-6;
  EXPECT_NEAR(trial_of(r).judged, 0.5, 1e-12);
  EXPECT_EQ(trial_of(r).worst_of, "swing at rest");
  r.change = 2;
  EXPECT_NEAR(trial_of(r).judged, 2, 1e-6);
  EXPECT_EQ(trial_of(r).worst_of, "change of the force in a tick");
  r.made = 5e-6;
  EXPECT_NEAR(trial_of(r).judged, 5, 1e-9);
  r.pull = 1.2;
  EXPECT_NEAR(trial_of(r).judged, 10, 1e-9);
  r.finite = false;
  EXPECT_TRUE(std::isinf(trial_of(r).judged));
}

}  // namespace
}  // namespace hapticd
