#include "physics/simulation/world.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "physics/tissue/fragments.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

Instrument sphere_tip(double radius) {
  Instrument i;
  Primitive tip;
  tip.shape = Shape::sphere;
  tip.radius = radius;
  i.primitives = {tip};
  return i;
}

BodySettings soft_block(int n = 6) {
  BodySettings b{"block", true, box_mesh(Vec3(0.02, 0.02, 0.02), n, n, n), {5000, 0.4, 1000, 5, 0.002}, {},
                 0,       true};
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  return b;
}

WorldSettings settings(double h) {
  WorldSettings s;
  s.h = h;
  s.alarm_distance = 3e-3;
  s.sample_spacing = 1e-3;
  s.coupling[0] = {500, 0.05, 0};
  s.removal[0] = {50, 5e-4, 1e-3, 50};
  return s;
}

InstrumentSample at(double x, double y, double z, bool phaco = false) {
  return {{Vec3(x, y, z), Quat::Identity()}, true, phaco, phaco};
}

double settled_force(World& world, const InstrumentSample& sample, double seconds, double h,
                     CondensedProblem& problem) {
  StepReport report;
  for (int i = 0; i < static_cast<int>(seconds / h); ++i)
    report = world.step([&] { return sample; }, problem);
  return report.contact.wrench[0].z();
}

// The theorem that the best-known framework breaks: newtons do not depend on the time step.
TEST(World, QuasiStaticForceIsTheSameForEveryStep) {
  auto problem = std::make_unique<CondensedProblem>();
  double reference = 0;
  for (const double h : {0.005, 0.010, 0.020, 0.040}) {
    World world({soft_block()}, sphere_tip(3e-3), settings(h));
    const double force = settled_force(world, at(0.01, 0.01, 0.0215), 2.0, h, *problem);
    EXPECT_GT(force, 1e-3);
    if (reference == 0) reference = force;
    EXPECT_NEAR(force, reference, 0.005 * reference) << "h = " << h;
  }
}

TEST(World, HapticSolveOfThePublishedProblemGivesTheSimulationsForce) {
  auto problem = std::make_unique<CondensedProblem>();
  World world({soft_block()}, sphere_tip(3e-3), settings(0.02));
  const InstrumentSample sample = at(0.01, 0.01, 0.0215);
  const double force = settled_force(world, sample, 3.0, 0.02, *problem);
  ContactState state;
  auto scratch = std::make_unique<ContactScratch>();
  ContactOptions options;
  options.linearisations = 3;
  options.margin = 1.5e-3;
  ContactSolution solution;
  for (int tick = 0; tick < 50; ++tick)
    solution = solve_contact(*problem, world.instruments(), sample.pose, 1e-3, options, state, *scratch);
  EXPECT_NEAR(solution.wrench[0].z(), force, 1e-6 * force);
}

TEST(World, RigidPlateAnswersWithTheCouplingAlone) {
  BodySettings plate{"plate", false, box_mesh(Vec3(0.02, 0.02, 0.002), 8, 8, 1), {}, {}, 0, false};
  World world({plate}, sphere_tip(3e-3), settings(0.02));
  auto problem = std::make_unique<CondensedProblem>();
  // The sphere's south pole 0.2 mm below the plate's top; samples are within a spacing of the pole, so
  // the overlap they see is short by at most spacing²/(2 r) = 0.17 mm; at a sample it is exact.
  const WorldSettings s = settings(0.02);
  double deepest = 0;
  const InstrumentSample sample = at(0.01, 0.01, 0.002 + 3e-3 - 2e-4);
  const double force = settled_force(world, sample, 0.2, 0.02, *problem);
  for (int i = 0; i < problem->samples; ++i)
    deepest = std::max(deepest, -gap_at(world.instruments()[0], sample.pose, problem->sample[i].free).distance);
  ASSERT_GT(deepest, 0);
  EXPECT_LE(force, s.coupling[0].stiffness * 2e-4 * (1 + 1e-6));
  EXPECT_GE(force, s.coupling[0].stiffness * deepest * (1 - 0.05));
}

TEST(World, AnUntouchedBodySleepsAndWakes) {
  World world({soft_block()}, sphere_tip(3e-3), settings(0.02));
  auto problem = std::make_unique<CondensedProblem>();
  StepReport report;
  for (int i = 0; i < 3; ++i) report = world.step([&] { return at(0.01, 0.01, 0.05); }, *problem);
  EXPECT_EQ(report.awake_bodies, 0);
  EXPECT_EQ(problem->samples, 0);
  report = world.step([&] { return at(0.01, 0.01, 0.0235); }, *problem);
  EXPECT_GT(problem->samples, 0);
  EXPECT_GT(problem->nodes, 0);
}

TEST(World, PedalRemovesAtTheRateOfTheScene) {
  World world({soft_block(8)}, sphere_tip(3e-3), settings(0.02));
  auto problem = std::make_unique<CondensedProblem>();
  int removed = 0;
  for (int i = 0; i < 50; ++i)
    removed += world.step([&] { return at(0.01, 0.01, 0.021, true); }, *problem).removed;
  EXPECT_GE(removed, 20);
  EXPECT_LE(removed, 50);
  const int before = world.removed();
  for (int i = 0; i < 10; ++i) world.step([&] { return at(0.01, 0.01, 0.021, false); }, *problem);
  EXPECT_EQ(world.removed(), before);
}

// Three tetrahedra in a row around an edge: the tip is in the middle one, and takes one a step. The last then
// hangs by the edge, unless it is held.
TEST(World, WhatTheTipLeavesHangingGoesAtOnce) {
  const auto alive_after = [](std::vector<int> fixed) {
    BodySettings row{"row", true, {}, {5000, 0.4, 1000, 5, 0.002}, std::move(fixed), 0, true};
    for (const Vec3& x :
         {Vec3(0, 0, 0), Vec3(0, 0, 1), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(-1, 0, 0), Vec3(0, -1, 0)})
      row.mesh.nodes.push_back(1e-2 * x);
    row.mesh.tets = {{0, 2, 3, 1}, {0, 3, 4, 1}, {0, 4, 5, 1}};
    World world({row}, sphere_tip(5e-4), settings(0.02));
    auto problem = std::make_unique<CondensedProblem>();
    InstrumentSample sample = at(-2.5e-3, 2.5e-3, 2.5e-3, true);
    sample.aspiration = false;
    const StepReport report = world.step([&] { return sample; }, *problem);
    const std::vector<std::uint8_t> alive = world.bodies()[0].state.alive;
    EXPECT_EQ(report.removed, std::count(alive.begin(), alive.end(), 0));
    return alive;
  };
  EXPECT_EQ(alive_after({2}), (std::vector<std::uint8_t>{1, 0, 0}));
  EXPECT_EQ(alive_after({2, 5}), (std::vector<std::uint8_t>{1, 0, 1}));
}

// Under a cell that is held, a tetrahedron by a face, and by its lowest node alone a weight, which pulls that
// face open. The tetrahedron then hangs by a node, and is gone a step later; the weight falls.
TEST(World, WhatACrackLeavesHangingGoesAStepLater) {
  BodySettings b{"cell", true, box_mesh(Vec3(0.01, 0.01, 0.01), 1, 1, 1), {2e4, 0.3, 1000, 1, 1e-3}, {},
                 0,      true};
  TetMesh& mesh = b.mesh;
  int cleft = -1;  // a face at x = 1 cm
  for (int id = 0; id < 4 * static_cast<int>(mesh.tets.size()); ++id) {
    const Triangle n = outward_face(mesh.tets[id / 4], id % 4);
    if (std::all_of(n.begin(), n.end(), [&](int k) { return mesh.nodes[k].x() > 0.0099; })) cleft = id;
  }
  ASSERT_GE(cleft, 0);
  for (int n = 0; n < 8; ++n)
    if (mesh.nodes[n].x() < 1e-9) b.fixed_nodes.push_back(n);
  const Triangle face = outward_face(mesh.tets[cleft / 4], cleft % 4);
  for (const Vec3& x : {Vec3(0.02, 0.005, 0.005), Vec3(0.03, 0, 0), Vec3(0.03, 0.03, 0), Vec3(0.03, 0, 0.03)})
    mesh.nodes.push_back(x);
  const int hanging = static_cast<int>(mesh.tets.size());
  mesh.tets.push_back({face[0], face[1], face[2], 8});
  mesh.tets.push_back({8, 9, 10, 11});
  b.room = {20, 0};
  b.toughness = 1e-6;
  b.tearing = {.toughness = 1e-6, .begins = true};
  b.tearing.clefts.assign(4 * mesh.tets.size(), 0);
  b.tearing.clefts[cleft] = b.tearing.clefts[4 * hanging + 3] = 1;
  WorldSettings s = settings(0.02);
  s.gravity = Vec3(9.81, 0, 0);
  World world({b}, sphere_tip(3e-3), s);
  auto problem = std::make_unique<CondensedProblem>();
  const auto step = [&] { return world.step([] { return InstrumentSample{}; }, *problem); };
  const TissueState& state = world.bodies()[0].state;
  int steps = 0;
  while (!step().split) ASSERT_LT(++steps, 50);
  EXPECT_EQ(state.removed, 0);
  EXPECT_EQ(step().removed, 1);
  EXPECT_FALSE(state.alive[hanging]);
  EXPECT_EQ(find_pieces(world.bodies()[0].model, state).count(), 2);
  for (int k = 0; k < 5; ++k) EXPECT_EQ(step().removed, 0);
  EXPECT_GT(state.v[9].x(), 0.5);
}

// What goes is where the tip will be in 2 ms, by its speed: after the same way in fifteen times the time it
// is where it is after a fifteenth of it in a step.
TEST(World, ATipSeenSeldomIsNotTakenForAFastOne) {
  // Comes down to 0.1 mm above the block; within the stroke's reach.
  const auto alive = [](double from, double time) {
    WorldSettings s = settings(0.02);
    s.removal[0].rate = 1e5;
    World world({soft_block(8)}, sphere_tip(2e-3), s);
    auto problem = std::make_unique<CondensedProblem>();
    InstrumentSample sample = at(0.01, 0.01, from);
    sample.time = time > 0 ? 1 : 0;
    world.step([&] { return sample; }, *problem);
    sample = at(0.01, 0.01, 0.0221, true);
    sample.time = time > 0 ? 1 + time : 0;
    world.step([&] { return sample; }, *problem);
    EXPECT_GT(world.removed(), 0);
    return world.bodies()[0].state.alive;
  };
  const auto in_a_step = alive(0.0221 + 0.8e-3, 0.02), seldom = alive(0.0221 + 12e-3, 0.3);
  EXPECT_EQ(seldom, in_a_step);
  EXPECT_EQ(alive(0.0221 + 0.8e-3, 0), in_a_step);  // no time: a step
  EXPECT_NE(alive(0.0221 + 12e-3, 0), in_a_step);
}

TEST(World, SurvivesRemovalDownToNothing) {
  WorldSettings s = settings(0.02);
  s.removal[0].rate = 1e5;
  World world({soft_block(4)}, sphere_tip(5e-3), s);
  auto problem = std::make_unique<CondensedProblem>();
  for (int i = 0; i < 200; ++i) {
    const double x = 0.02 * ((i * 37) % 100) / 100, y = 0.02 * ((i * 61) % 100) / 100, z = 0.024 - 1.2e-4 * i;
    const StepReport r = world.step([&] { return at(x, y, z, true); }, *problem);
    EXPECT_TRUE(r.contact.wrench[0].allFinite());
    for (const Vec3& p : world.bodies()[0].state.x) ASSERT_TRUE(p.allFinite());
  }
  EXPECT_GT(world.removed(), world.bodies()[0].model.tet_count() / 2);
}

}  // namespace
}  // namespace hapticd
