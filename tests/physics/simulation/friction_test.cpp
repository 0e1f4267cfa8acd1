// Coulomb friction between bodies, against the answers that one can write down.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>

#include "tests/support/rubbing_worlds.h"

namespace hapticd {
namespace {

constexpr double g = 9.81;
constexpr double degree = std::numbers::pi / 180;

// Whose step must be solved.
void step(Incline& incline) {
  const StepReport r = incline.step();
  EXPECT_EQ(r.body_contact.status, SolveStatus::solved) << r.body_contact.residual;
}

// Sticks below tan⁻¹ μ, slides above; a twentieth of a degree is told apart, on rigid and on soft ground.
TEST(Friction, ABlockSticksBelowTheFrictionAngleAndSlidesAboveIt) {
  for (const bool soft : {false, true})
    for (const double mu : {0.1, 0.4, 1.0}) {
      const double limit = std::atan(mu), bracket = 0.05 * degree;
      Incline below(limit - bracket, mu, soft), above(limit + bracket, mu, soft);
      for (int i = 0; i < 40; ++i) {
        step(below);
        step(above);
      }
      const double start = centre_of(below.body()).dot(below.down), v = above.speed();
      for (int i = 0; i < 50; ++i) {
        step(below);
        step(above);
      }
      const double crept = centre_of(below.body()).dot(below.down) - start;
      const double a = (above.speed() - v) / (50 * 0.02);
      const double hand = g * (std::sin(limit + bracket) - mu * std::cos(limit + bracket));
      std::printf("  mu %.1f, %s: below crept %.1e m in 1 s; above a = %.5f m/s2, by hand %.5f\n", mu,
                  soft ? "soft" : "rigid", crept, a, hand);
      EXPECT_LT(std::abs(crept), 1e-9);
      EXPECT_NEAR(a, hand, (soft ? 3e-5 : 1e-7) * g);
    }
}

TEST(Friction, ASlidingBlockAcceleratesWithGravityLessFriction) {
  for (const double mu : {0.0, 0.1, 0.3}) {
    const double angle = 20 * degree, hand = g * (std::sin(angle) - mu * std::cos(angle));
    Incline incline(angle, mu);
    for (int i = 0; i < 10; ++i) step(incline);
    const double v = incline.speed();
    for (int i = 0; i < 10; ++i) step(incline);
    EXPECT_NEAR((incline.speed() - v) / 0.2, hand, 1e-6 * g) << mu;
    const Vec3 force = incline.world->contacts().force_on(0);
    const double m = mass_of(incline.body());
    EXPECT_NEAR(force.dot(-incline.down), mu * m * g * std::cos(angle), 1e-5 * m * g);
  }
}

// A soft pad on a rigid floor is pushed along by the instrument at constant speed: what the hand feels is
// μ N, N = m g + what the ball adds downwards, through the tissue, the floor's contacts and both solvers.
TEST(Friction, ADraggedPadResistsWithMuTimesItsWeight) {
  const double mu = 0.3, speed = 5e-3, radius = 2e-3;
  WorldSettings s = contact_world({{0, 1, mu}});
  s.gravity = Vec3(0, 0, -g);
  const BodySettings pad = block("pad", Vec3(0.012, 0.012, 0.005), {6, 6, 3}, {20e3, 0.4, 1000, 0, 2e-3});
  World world({pad, slab("floor", Vec3(0.08, 0.03, 0.003), {8, 3, 1},
                         {Vec3(-0.01, -0.009, -0.003), Quat::Identity()})},
              ball(radius), s);
  auto problem = std::make_unique<CondensedProblem>();
  const double weight = mass_of(world.bodies()[0]) * g;
  StepReport r;
  // The ball pushes low, so that the pad does not tip: its centre at a ball's radius above the floor.
  for (int i = 0; i < 150; ++i) {
    r = world.step([&] { return at(Vec3(-radius - 2e-4 + speed * 0.02 * i, 0.006, 2.1e-3)); }, *problem);
    EXPECT_LT(r.body_contact.residual, 1e-6);
    if (i < 100) continue;
    const Vec3 floor = world.contacts().force_on(0);
    EXPECT_NEAR(floor.z(), weight + r.contact.wrench[0].z(), 1e-5 * weight);
    EXPECT_NEAR(floor.head<2>().norm(), mu * floor.z(), 1e-5 * weight);
    EXPECT_NEAR(r.contact.wrench[0].head<2>().norm(), mu * floor.z(), 1e-4 * weight);
    EXPECT_NEAR(velocity_of(world.bodies()[0]).x(), speed, 0.01 * speed);
  }
  std::printf("  felt %.5f mN, mu N = %.5f mN, mu m g = %.5f mN\n",
              1e3 * r.contact.wrench[0].head<2>().norm(), 1e3 * mu * world.contacts().force_on(0).z(),
              1e3 * mu * weight);
}

// A wedge of half angle α, pressed between two rigid walls and let go, stays where α < tan⁻¹ μ and comes out
// where α > tan⁻¹ μ. Pressing never jams (Painlevé): every step has a solution, with bounded forces.
TEST(Friction, AWedgeLocksBelowTheFrictionAngleAndLetsGoAbove) {
  const double mu = 0.3;
  for (const bool locks : {true, false}) {
    const double alpha = std::atan(mu) + (locks ? -3 : 3) * degree;
    Wedge wedge(alpha, mu);
    for (int i = 0; i < Wedge::steps; ++i) {
      const StepReport r = wedge.step();
      EXPECT_LT(r.body_contact.residual, 1e-6) << i;
      EXPECT_LT(r.body_contact.penetration, 2e-6) << i;
    }
    const double pressed = wedge.pressed, applied = wedge.applied;
    const double left = wedge.on_wall(0).norm(), right = wedge.on_wall(1).norm();
    std::printf(
        "  half angle %.1f deg, friction angle %.1f deg: wall %.2f mN under %.2f mN; let go: %.3f, %.3f mN\n",
        alpha / degree, std::atan(mu) / degree, 1e3 * pressed, 1e3 * applied, 1e3 * left, 1e3 * right);
    EXPECT_GT(pressed, 0.9 * applied * wedge.sliding_in());
    if (locks) {
      EXPECT_GT(left, 0.05 * pressed);
      EXPECT_NEAR(left, right, 1e-6 * left);
      EXPECT_LT(fastest_node(wedge.world->bodies()[0]), 1e-5);
    } else {
      EXPECT_LT(left, 1e-3 * pressed);
    }
  }
}

}  // namespace
}  // namespace hapticd
