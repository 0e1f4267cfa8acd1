// Models cheaper than the whole: what they are exact in, and that a term which is absent costs nothing.
#include <gtest/gtest.h>

#include <ctime>

#include "physics/simulation/world.h"
#include "tests/support/bodies.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double side = 20e-3;

BodySettings pad(bool corotational, bool dynamic, const Vec3&) {
  BodySettings b;
  b.name = "pad";
  b.mesh = box_mesh({side, side, side / 2}, 6, 6, 3);
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  b.material = {5e3, 0.4, 1000, 2, 1e-3};
  b.corotational = corotational;
  b.dynamic = dynamic;
  return b;
}

WorldSettings settings(const Vec3& gravity = Vec3::Zero()) {
  WorldSettings s;
  s.alarm_distance = 3e-3;
  s.sample_spacing = 1e-3;
  s.coupling[0] = {400, 0.04, 0};
  s.gravity = gravity;
  return s;
}

World pad_world(bool corotational, bool dynamic, const Vec3& gravity = Vec3::Zero()) {
  std::vector<BodySettings> bodies;
  bodies.push_back(pad(corotational, dynamic, gravity));
  return World(std::move(bodies), ball(3e-3), settings(gravity));
}

InstrumentSample pressed(double depth) { return at({side / 2, side / 2, side / 2 + 3e-3 - depth}); }

StepReport hold(World& world, double depth, int steps, CondensedProblem& problem) {
  StepReport report;
  for (int i = 0; i < steps; ++i) report = world.step([&] { return pressed(depth); }, problem);
  return report;
}

// Statics is where dynamics ends: the same force at rest, with and without gravity, for each element law; and
// the static body is there in one step.
TEST(Economy, AStaticBodyIsWhereADynamicOneComesToRest) {
  const auto problem = std::make_unique<CondensedProblem>();
  for (const bool corotational : {true, false})
    for (const double g : {0.0, -9.81}) {
      World dynamic = pad_world(corotational, true, {0, 0, g}),
            still = pad_world(corotational, false, {0, 0, g});
      const Vec3 f = hold(dynamic, 1e-3, 100, *problem).contact.wrench[0].head<3>();
      const Vec3 s = hold(still, 1e-3, 20, *problem).contact.wrench[0].head<3>();
      EXPECT_GT(f.norm(), 1e-3);
      EXPECT_LT((f - s).norm(), 1e-4 * f.norm()) << corotational << g;
    }
}

// Without inertia and turning nothing remembers: one step from anywhere is the equilibrium.
TEST(Economy, ALinearStaticBodyHasNoMemory) {
  const auto problem = std::make_unique<CondensedProblem>();
  World world = pad_world(false, false);
  hold(world, 2e-3, 5, *problem);
  hold(world, 0.5e-3, 20, *problem);
  World fresh = pad_world(false, false);
  hold(fresh, 0.5e-3, 20, *problem);
  const auto &a = world.bodies()[0].state.x, &b = fresh.bodies()[0].state.x;
  for (std::size_t n = 0; n < a.size(); ++n) EXPECT_LT((a[n] - b[n]).norm(), 1e-9);
}

// f_int = −K u: twice the load is twice the displacement.
TEST(Economy, ALinearBodyIsLinear) {
  const BodySettings settings = pad(false, true, Vec3::Zero());
  TissueModel model = make_tissue_model(settings.mesh, settings.material, settings.fixed_nodes, Vec3::Zero());
  model.corotational = false;
  TissueState state = rest_state(model);
  VecX one(3 * model.node_count()), two(3 * model.node_count());
  const auto shear = [&](double amount) {
    for (std::size_t n = 0; n < state.x.size(); ++n)
      state.x[n] = model.mesh.nodes[n] + amount * model.mesh.nodes[n].z() * Vec3(1, 0.3, -0.2);
    update_rotations(model, state);
  };
  shear(0.4);
  internal_forces(model, state, one);
  shear(0.8);
  internal_forces(model, state, two);
  EXPECT_GT(one.norm(), 0);
  EXPECT_LT((two - 2 * one).norm(), 1e-12 * two.norm());
}

TEST(Economy, AStaticBodyCannotBeCut) {
  BodySettings b = pad(true, false, Vec3::Zero());
  b.removable = true;
  std::vector<BodySettings> bodies;
  bodies.push_back(std::move(b));
  EXPECT_THROW(World(std::move(bodies), ball(3e-3), settings()), std::invalid_argument);
}

// A factor that serves: a linear body's step costs no factor while the zone stays, and is right when it
// moves.
TEST(Economy, ALinearBodysForceDoesNotDependOnWhenItWasFactored) {
  const auto problem = std::make_unique<CondensedProblem>();
  World walked = pad_world(false, false), fresh = pad_world(false, false);
  const auto beside = [](double x) { return at({x, side / 2, side / 2 + 2e-3}); };
  for (double x = 2e-3; x < 18e-3; x += 0.5e-3) walked.step([&] { return beside(x); }, *problem);
  StepReport a, b;
  for (int i = 0; i < 30; ++i) a = walked.step([&] { return beside(15e-3); }, *problem);
  for (int i = 0; i < 30; ++i) b = fresh.step([&] { return beside(15e-3); }, *problem);
  EXPECT_GT(a.contact.wrench[0].norm(), 1e-3);
  EXPECT_LT((a.contact.wrench[0] - b.contact.wrench[0]).norm(), 1e-6 * a.contact.wrench[0].norm());
}

double cpu_us() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

double median_step_us(World& world, const InstrumentSample& sample) {
  const auto problem = std::make_unique<CondensedProblem>();
  for (int i = 0; i < 20; ++i) world.step([&] { return sample; }, *problem);
  std::vector<double> us(101);
  for (double& t : us) {
    const double begun = cpu_us();
    world.step([&] { return sample; }, *problem);
    t = cpu_us() - begun;
  }
  std::sort(us.begin(), us.end());
  return us[us.size() / 2];
}

// Not a test: prints a table of physics/MEASURED.md. Run by
//   test_physics --gtest_also_run_disabled_tests --gtest_filter='*EconomyTiming*'
TEST(EconomyTiming, DISABLED_WhatATermCosts) {
  const auto row = [](const char* what, double us) { std::printf("%-60s %9.1f us\n", what, us); };
  const auto world_of = [](std::vector<BodySettings> bodies) {
    return World(std::move(bodies), ball(3e-3), settings());
  };
  const auto lens_sized = [](bool corotational, bool dynamic) {
    BodySettings b = pad(corotational, dynamic, Vec3::Zero());
    b.mesh = box_mesh({side, side, side / 2}, 10, 10, 8);
    b.fixed_nodes = b.mesh.group("bottom")->nodes;
    return b;
  };
  const auto one = [&](BodySettings b) {
    std::vector<BodySettings> bodies;
    bodies.push_back(std::move(b));
    return world_of(std::move(bodies));
  };
  for (const bool corotational : {true, false})
    for (const bool dynamic : {true, false}) {
      World world = one(lens_sized(corotational, dynamic));
      row((std::string(corotational ? "corotational" : "linear") + (dynamic ? ", dynamic" : ", static"))
              .c_str(),
          median_step_us(world, pressed(1e-3)));
    }
  World with_friction = [&] {
    BodySettings b = lens_sized(true, true);
    b.friction = 0.3;
    return one(std::move(b));
  }();
  row("corotational, dynamic, with friction", median_step_us(with_friction, pressed(1e-3)));
  const auto beside = [&](bool deformable) {
    std::vector<BodySettings> bodies;
    bodies.push_back(lens_sized(true, true));
    BodySettings far = lens_sized(true, true);
    for (Vec3& x : far.mesh.nodes) x.x() += 1;
    far.deformable = deformable;
    bodies.push_back(std::move(far));
    return world_of(std::move(bodies));
  };
  World asleep = beside(true), still = beside(false);
  row("... and the same body again out of reach, asleep", median_step_us(asleep, pressed(1e-3)));
  row("... as an obstacle", median_step_us(still, pressed(1e-3)));
}

}  // namespace
}  // namespace hapticd
