#include "haptic/passivity.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

Pose at(double x) { return {Vec3(x, 0, 0), Quat::Identity()}; }

TEST(Passivity, PressingASampledSpringInAndOutMakesTheEnergyOfTheHold) {
  // F_k = −K x_k held for one tick: in over N steps of Δ costs K Δ² N(N−1)/2, out gives K Δ² N(N+1)/2.
  constexpr double K = 1000, step = 1e-4;
  constexpr int N = 20;
  PassivityState state;
  Wrench held;
  for (int k = 0; k <= 2 * N; ++k) {
    const double x = step * (k <= N ? k : 2 * N - k);
    observe(state, at(x), held);
    held.force = Vec3(-K * x, 0, 0);
    if (k == N) {
      EXPECT_NEAR(state.energy, K * step * step * N * (N - 1) / 2, 1e-15);
    }
  }
  EXPECT_NEAR(state.energy, -K * step * step * N, 1e-15);
}

TEST(Passivity, AStillHandDoesNoWorkAndADamperOnlyTakes) {
  PassivityState state;
  observe(state, at(0), {});
  observe(state, at(0), {Vec3(3, 0, 0), Vec3::Zero()});
  EXPECT_EQ(state.energy, 0);
  for (int k = 1; k < 10; ++k) observe(state, at(0.001 * k), {Vec3(-0.5, 0, 0), Vec3::Zero()});
  EXPECT_NEAR(state.energy, 0.0045, 1e-12);
  EXPECT_EQ(passivity_force(state, Vec3(1, 0, 0), 5, 1e-3), Vec3::Zero());
}

TEST(Passivity, RotationWorksAgainstTorque) {
  PassivityState state;
  observe(state, at(0), {});
  const Pose turned{Vec3::Zero(), Quat(Eigen::AngleAxisd(0.2, Vec3::UnitZ()))};
  observe(state, turned, {Vec3::Zero(), Vec3(0, 0, -0.1)});
  EXPECT_NEAR(state.energy, 0.02, 1e-12);
}

TEST(Passivity, ControllerTakesTheDeficitInOneTickWhereDampingAllows) {
  PassivityState state;
  state.energy = -1e-6;
  const Vec3 v(0.02, 0, 0);
  const Vec3 f = passivity_force(state, v, 5, 1e-3);
  EXPECT_NEAR(f.dot(v) * 1e-3, -1e-6, 1e-18);   // dissipates exactly the deficit
  EXPECT_NEAR(passivity_force(state, v, 1, 1e-3).x(), -0.02, 1e-15);  // capped at b = 1
}

}  // namespace
}  // namespace hapticd
