// Bodies that touch one another: theorems with hand answers.
#include "physics/simulation/body_contact/body_contact.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numeric>

#include "tests/support/rubbing_worlds.h"

namespace hapticd {
namespace {

constexpr double g = 9.81;

// A cube mapped smoothly to a ball about the origin.
BodySettings round_body(double radius, int n, const Material& material, const Vec3& centre) {
  BodySettings b = block("ball", Vec3(2, 2, 2), {n, n, n}, material, {Vec3(-1, -1, -1), Quat::Identity()});
  for (Vec3& p : b.mesh.nodes) {
    const double x = p.x() * p.x(), y = p.y() * p.y(), z = p.z() * p.z();
    p = Vec3(p.x() * std::sqrt(1 - y / 2 - z / 2 + y * z / 3),
             p.y() * std::sqrt(1 - z / 2 - x / 2 + z * x / 3),
             p.z() * std::sqrt(1 - x / 2 - y / 2 + x * y / 3));
    p = radius * p + centre;
  }
  return b;
}

// Three walls that meet at the origin, facing +x, +y, +z.
std::vector<BodySettings> corner_walls() {
  std::vector<BodySettings> walls;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 size = Vec3::Constant(0.04), p = Vec3::Constant(-0.01);
    size[axis] = 0.005;
    p[axis] = -0.005;
    walls.push_back(slab("wall", size, {2, 2, 2}, {p, Quat::Identity()}));
  }
  return walls;
}

TEST(BodyContact, ABallInACornerIsHeldByStatics) {
  const double radius = 5e-3;
  std::vector<BodySettings> bodies = corner_walls();
  bodies.push_back(round_body(radius, 6, {20e3, 0.4, 1000, 5, 5e-3}, Vec3::Constant(radius + 1e-4)));
  for (const double mu : {0.0, 0.5}) {
    WorldSettings s = contact_world({{3, 0, mu}, {3, 1, mu}, {3, 2, mu}});
    s.gravity = -g * Vec3(1, 2, 3).normalized();
    World world(bodies, ball(1e-3), s);
    auto problem = std::make_unique<CondensedProblem>();
    StepReport r;
    for (int i = 0; i < 100; ++i) {
      r = world.step([] { return nobody(); }, *problem);
      EXPECT_LE(r.body_contact.penetration, 1e-6);
      EXPECT_EQ(r.body_contact.status, SolveStatus::solved);
    }
    const double m = mass_of(world.bodies()[3]);
    // A body sleeps once no node is faster than 10 um/s; what that would still slow down in a step is
    // missing.
    const double still = 5e-5 * m * g;
    Vec3 sum = Vec3::Zero();
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3 wall = -world.contacts().force_on(axis);
      sum += wall;
      // Without friction each wall holds its share of the weight, along its normal alone.
      if (mu == 0) {
        EXPECT_NEAR(wall[axis], -m * s.gravity[axis], still);
        EXPECT_NEAR((wall - wall[axis] * Vec3::Unit(axis)).norm(), 0, 1e-9 * m * g);
      }
    }
    EXPECT_LT((sum + m * s.gravity).norm(), 2 * still);
  }
}

// Three blocks in a row, the first pushed into the second by the instrument, nothing holding any of them.
TEST(BodyContact, NewtonsThirdLawOverAllBodies) {
  const Material soft{10e3, 0.4, 1000, 0, 2e-3};
  const auto in_row = [&](const char* name, double x) {
    return block(name, Vec3(6e-3, 6e-3, 6e-3), {3, 3, 3}, soft,
                 {Vec3(x, 1e-4 * x / 1e-3, 0), Quat::Identity()});
  };
  World world({in_row("a", 0), in_row("b", 6.2e-3), in_row("c", 12.4e-3)}, ball(2e-3),
              contact_world({{0, 1, 0.4}, {1, 2, 0.2}}));
  auto problem = std::make_unique<CondensedProblem>();
  const auto momentum = [&] {
    Vec3 sum = Vec3::Zero();
    for (const Body& b : world.bodies()) sum += mass_of(b) * velocity_of(b);
    return sum;
  };
  double worst = 0, worst_momentum = 0, largest = 0;
  int touching = 0;
  Vec3 before = momentum();
  for (int i = 0; i < 60; ++i) {
    const double x = -2.2e-3 + std::min(i, 25) * 2e-4;
    const StepReport r = world.step([&] { return at(Vec3(x, 3.1e-3, 2.9e-3)); }, *problem);
    Vec3 sum = Vec3::Zero();
    for (int b = 0; b < 3; ++b) sum += world.contacts().force_on(b);
    const double size = world.contacts().force_on(1).norm() + world.contacts().force_on(2).norm();
    if (size > 0) worst = std::max(worst, sum.norm() / size);
    touching += r.body_contact.active > 0;
    // The instrument's force is all that the bodies gain together.
    const Vec3 gained = (momentum() - before) / 0.02, given = -r.contact.wrench[0].head<3>();
    before = momentum();
    largest = std::max(largest, given.norm());
    if (r.contact.active == 0) worst_momentum = std::max(worst_momentum, gained.norm());
    EXPECT_LT((gained - given).norm(), 1e-5 * std::max(largest, 1e-9)) << i;
  }
  std::printf(
      "  %d steps in touch: forces sum to %.1e of themselves; momentum without the instrument changes by "
      "%.1e\n",
      touching, worst, worst_momentum / largest);
  EXPECT_GT(touching, 10);
  EXPECT_LT(worst, 1e-12);
  EXPECT_LT(worst_momentum, 1e-11 * largest);  // round-off of C
}

// Overlap that should not be there (a bad start, a stall) ends at the recovery speed, not in a burst.
TEST(BodyContact, DeepPenetrationRecoversWithoutABurst) {
  for (const double mu : {0.0, 0.3}) {
    const WorldSettings s = contact_world({{0, 1, mu}});
    World world(
        {block("block", Vec3(6e-3, 6e-3, 6e-3), {3, 3, 3}, {5000, 0.4, 1000, 0, 2e-3},
               {Vec3(0, 0, -1e-3), Quat::Identity()}),
         slab("floor", Vec3(0.02, 0.02, 5e-3), {4, 4, 1}, {Vec3(-7e-3, -7e-3, -5e-3), Quat::Identity()})},
        ball(1e-3), s);
    auto problem = std::make_unique<CondensedProblem>();
    double fastest = 0;
    for (int i = 0; i < 30; ++i) {
      world.step([] { return nobody(); }, *problem);
      fastest = std::max(fastest, fastest_node(world.bodies()[0]));
    }
    std::printf("  1 mm deep, mu %.1f: fastest node %.2f mm/s, %.1e m deep after 0.6 s\n", mu, 1e3 * fastest,
                deepest_inside(world.bodies()[0], world.bodies()[1]));
    EXPECT_LT(fastest, 1.05 * s.body_contact.recovery_speed);
    EXPECT_LT(deepest_inside(world.bodies()[0], world.bodies()[1]), 1e-9);
  }
}

struct Stack {
  std::unique_ptr<World> world;
  CondensedProblem problem;

  explicit Stack(double mu, bool gravity = true, bool contacts = true, double apart = 1e-5)
      : world(block_on_block({mu, gravity, contacts, apart})) {}
  StepReport step(const InstrumentSample& sample) {
    return world->step([&] { return sample; }, problem);
  }
};

TEST(BodyContact, WhatIsPressedOnAnotherBodyPressesItWithWeightAndForce) {
  Stack stack(0.5);
  StepReport r;
  for (int i = 0; i < 120; ++i) {
    const double depth = std::min(8e-4, 2e-5 * i);
    r = stack.step(at(Vec3(6e-3, 6e-3, 0.01 + 2e-3 - depth)));
    EXPECT_LE(r.body_contact.penetration, 1e-6);
  }
  const double weight = mass_of(stack.world->bodies()[0]) * g, pressed = r.contact.wrench[0].z();
  EXPECT_GT(pressed, 1e-3);
  EXPECT_NEAR(-stack.world->contacts().force_on(1).z(), weight + pressed, 1e-5 * (weight + pressed));
  EXPECT_LT(fastest_node(stack.world->bodies()[0]), 1e-5);
}

// The haptic loop's view: at the step's own pose the condensed problem gives the step's force; away from it
// only what is frozen differs from the full problem.
TEST(BodyContact, CondensedProblemAgainstTheFullOne) {
  for (const double mu : {0.0, 0.5}) {
    Stack stack(mu);
    const auto place = [](double depth, double along = 0) {
      return at(Vec3(6e-3 + along, 6e-3, 0.01 + 2e-3 - depth));
    };
    StepReport r;
    for (int i = 0; i < 150; ++i) r = stack.step(place(std::min(8e-4, 2e-5 * i)));
    const auto scratch = std::make_unique<ContactScratch>();
    ContactOptions options;
    options.linearisations = 5;
    options.margin = 5e-4;
    const auto haptic = [&](const InstrumentSample& sample) {
      ContactState state;
      for (int k = 0; k < 3; ++k)
        solve_contact(stack.problem, stack.world->instruments(), sample.pose, 0.02, options, state, *scratch);
      return solve_contact(stack.problem, stack.world->instruments(), sample.pose, 0.02, options, state,
                           *scratch);
    };
    const double peak = r.contact.wrench[0].head<3>().norm();
    EXPECT_NEAR(haptic(place(8e-4)).wrench[0].z(), r.contact.wrench[0].z(), 1e-5 * peak);
    for (const double moved : {1e-5, 1e-4, 2e-4, 4e-4})
      for (const bool sideways : {false, true}) {
        const InstrumentSample sample = sideways ? place(8e-4, moved) : place(8e-4 + moved);
        const Vec3 full = stack.world->solve_unfrozen(sample, stack.problem).wrench[0].head<3>();
        const Vec3 condensed = haptic(sample).wrench[0].head<3>();
        const double error = (condensed - full).norm() / full.norm();
        std::printf("  mu %.1f, moved %3.0f um %s: condensed off by %.2e of %.3f mN\n", mu, 1e6 * moved,
                    sideways ? "sideways" : "deeper  ", error, 1e3 * full.norm());
        // Sideways without friction the upper block rides along, and its contacts open and close meanwhile.
        const double frozen = mu == 0 && sideways ? 400 : 50;  // relative error per metre moved
        EXPECT_LT(error, frozen * moved + 5e-4);
      }
  }
}

TEST(BodyContact, BodiesThatDoNotTouchMoveBitForBitAsIfTheyCouldNot) {
  Stack with(0.3, false, true, 2e-3), without(0.3, false, false, 2e-3);
  for (int i = 0; i < 20; ++i) {
    const auto sample = at(Vec3(6e-3 + 1e-4 * i, 6e-3, 0.012 + 2e-3 - 2e-5 * i));
    const StepReport a = with.step(sample), b = without.step(sample);
    EXPECT_EQ(a.contact.wrench[0], b.contact.wrench[0]);
    for (int body = 0; body < 2; ++body)
      EXPECT_EQ(with.world->bodies()[body].state.x, without.world->bodies()[body].state.x) << i;
    EXPECT_EQ(MatX(with.problem.C()), MatX(without.problem.C()));
  }
}

TEST(BodyContact, WhatRestsSleepsAndWhatIsTouchedByAMovingBodyWakes) {
  Stack stack(0.5);
  StepReport r;
  for (int i = 0; i < 60; ++i) r = stack.step(nobody());
  EXPECT_EQ(r.awake_bodies, 0);
  // The instrument presses the upper; the lower is out of its reach and is woken by its neighbour alone.
  int woke = -1;
  for (int i = 0; i < 40 && woke < 0; ++i) {
    r = stack.step(at(Vec3(6e-3, 6e-3, 0.01 + 2e-3 - 1e-5 * i)));
    if (r.awake_bodies == 2) woke = i;
  }
  EXPECT_GE(woke, 0);
}

// The tip eats the ground away beside a block at rest: it wakes, and sinks or tips without a jump.
TEST(BodyContact, GroundRemovedUnderABodyAtRest) {
  Stack stack(0.5);
  StepReport r;
  for (int i = 0; i < 60; ++i) r = stack.step(nobody());
  double deepest = 0, fastest = 0;
  for (int i = 0; i < 120; ++i) {
    InstrumentSample sample = at(Vec3(-1e-3 + 3e-5 * i, 6e-3, 3.5e-3));
    sample.phaco = true;
    r = stack.step(sample);
    deepest = std::max(deepest, r.body_contact.penetration);
    fastest = std::max(fastest, fastest_node(stack.world->bodies()[0]));
    for (const Vec3& x : stack.world->bodies()[0].state.x) ASSERT_TRUE(x.allFinite());
  }
  std::printf("  %d tetrahedra removed, deepest overlap %.1e m, fastest node %.1f mm/s\n",
              stack.world->removed(), deepest, 1e3 * fastest);
  EXPECT_GT(stack.world->removed(), 50);
  EXPECT_LT(deepest, 10e-6);
  EXPECT_LT(fastest, 0.3);
}

// No ghosts: a node within a wall's thickness of its back, or inside of what it does not face, feels nothing.
TEST(BodyContact, NoGhostContactsFromBehindOrInside) {
  const auto floor =
      slab("floor", Vec3(0.02, 0.02, 1e-3), {4, 4, 1}, {Vec3(-7e-3, -7e-3, -1e-3), Quat::Identity()});
  const auto above = block("block", Vec3(6e-3, 6e-3, 1.5e-3), {3, 3, 1}, {5000, 0.4, 1000, 0, 2e-3},
                           {Vec3(0, 0, 5e-5), Quat::Identity()});
  World world({above, floor}, ball(1e-3), contact_world({{0, 1, 0.3}}));
  auto problem = std::make_unique<CondensedProblem>();
  const std::vector<Vec3> before = world.bodies()[0].state.x;
  for (int i = 0; i < 10; ++i) {
    const StepReport r = world.step([] { return nobody(); }, *problem);
    EXPECT_EQ(r.body_contact.active, 0);
  }
  for (std::size_t n = 0; n < before.size(); ++n)
    EXPECT_LT((world.bodies()[0].state.x[n] - before[n]).norm(), 1e-15);
}

// Where a solve with friction does not end, friction is held as it was found: at a solution that changes
// nothing, and the normal forces stay an answer of their own.
TEST(BodyContact, FrictionHeldAtASolutionLeavesIt) {
  constexpr double h = 0.02;
  const Material soft{5000, 0.4, 1000, 0, 2e-3};
  Bodies bodies;
  bodies.emplace_back(slab("floor", Vec3(0.02, 0.02, 4e-3), {5, 5, 2}), h, Vec3::Zero());
  bodies.emplace_back(
      block("block", Vec3(6e-3, 6e-3, 6e-3), {3, 3, 3}, soft, {Vec3(7.1e-3, 7.2e-3, 4e-3), Quat::Identity()}),
      h, Vec3(3, 1, -g));
  std::vector<int> all(bodies[1].state.x.size());
  std::iota(all.begin(), all.end(), 0);
  bodies[1].compliance->move_zone(all);
  bodies[1].compliance->update(bodies[1].state);
  compute_free_motion(bodies[1], h);
  finish_free_motion(bodies[1], nullptr);
  for (const double mu : {0.1, 0.6}) {
    BodyContacts contacts({{{1, 0, mu}}}, h);
    contacts.find(bodies);
    contacts.set_domains(bodies, {});
    const auto nodes = contacts.domain_nodes(1);
    MatX& C = contacts.compliance(1);
    C.resize(3 * static_cast<Eigen::Index>(nodes.size()), 3 * static_cast<Eigen::Index>(nodes.size()));
    bodies[1].compliance->patch(nodes, C);
    contacts.set_free_motion(bodies);
    const auto force = [&] {
      VecX f = VecX::Zero(bodies[1].free.dx.size());
      contacts.solve(VecX());
      contacts.add_forces(1, f);
      return f;
    };
    const VecX free = force();
    ASSERT_EQ(contacts.report().status, SolveStatus::solved);
    EXPECT_GT(contacts.report().active, 5);
    EXPECT_EQ(contacts.add_violated(bodies, 1e-6), 0);
    contacts.hold_friction(true);
    const VecX held = force();
    EXPECT_EQ(contacts.report().status, SolveStatus::solved);
    EXPECT_LT((held - free).norm(), 1e-6 * free.norm()) << mu;
  }
}

TEST(BodyContact, APairNamesTwoBodies) {
  for (const ContactPair& pair : {ContactPair{0, 0, 0}, ContactPair{0, 2, 0}, ContactPair{-1, 0, 0}})
    EXPECT_THROW(World({slab("a", Vec3(1, 1, 1), {1, 1, 1}), slab("b", Vec3(1, 1, 1), {1, 1, 1})}, ball(1e-3),
                       contact_world({pair})),
                 std::invalid_argument);
}

}  // namespace
}  // namespace hapticd
