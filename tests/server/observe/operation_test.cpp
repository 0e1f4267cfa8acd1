// What an operation's measures say of steps whose answer is known.
#include "server/observe/operation.h"

#include <gtest/gtest.h>

#include "physics/simulation/sample_id.h"
#include "tests/support/bodies.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double period = 0.02;

WorldSettings settings() {
  WorldSettings s = contact_world({});
  s.h = period;
  s.alarm_distance = 2e-3;
  s.sample_spacing = 2e-3;
  s.coupling = VirtualCoupling{.stiffness = 100, .rotational_stiffness = 0.1, .damping_time = 2e-3};
  return s;
}

// A bar of eight cells held at its lower end, far above it a ball.
struct Bar {
  Bar() {
    BodySettings bar{"bar", true, box_mesh(Vec3(0.01, 0.01, 0.08), 1, 1, 8), {5000, 0.3, 1000, 5, 0.002}, {},
                     0,     true};
    bar.fixed_nodes = bar.mesh.group("bottom")->nodes;
    std::vector<BodySettings> bodies;
    bodies.push_back(std::move(bar));
    world = std::make_unique<World>(std::move(bodies), ball(5e-3), settings());
    hand.present = true;
    hand.pose.p = Vec3(0.005, 0.005, 0.2);
  }
  void step(Operation& operation) {
    const StepReport report = world->step([&] { return InstrumentSamples(hand); }, *problem);
    operation.follow(*world, report, InstrumentSamples(hand), period);
  }
  std::vector<int> cell(int k) const {
    std::vector<int> tets;
    const Body& body = world->bodies()[0];
    for (int t = 0; t < body.model.tets_in_use; ++t) {
      double z = 0;
      for (const int n : body.model.mesh.tets[t]) z += 0.25 * body.rest()[n].z();
      if (z > 0.01 * k && z < 0.01 * (k + 1)) tets.push_back(t);
    }
    return tets;
  }
  std::unique_ptr<World> world;
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  InstrumentSample hand;
};

TEST(Operation, ATipDrawnAroundASquareHasGoneItsSides) {
  Bar bar;
  Operation operation(*bar.world);
  const Vec3 start = bar.hand.pose.p;
  bar.step(operation);
  for (const Vec3& to : {Vec3(0.01, 0, 0), Vec3(0.01, 0.01, 0), Vec3(0, 0.01, 0), Vec3(0, 0, 0)}) {
    bar.hand.phaco = to.y() > 0;
    bar.hand.pose.p = start + to;
    bar.step(operation);
  }
  const OperationMeasures m = operation.measures();
  ASSERT_EQ(m.hands.size(), 1u);
  EXPECT_NEAR(m.hands[0].path, 0.04, 1e-12);
  EXPECT_NEAR(m.time, 5 * period, 1e-12);
  EXPECT_NEAR(m.hands[0].emulsifying, 2 * period, 1e-12);
  EXPECT_EQ(m.hands[0].touching, 0);
  EXPECT_EQ(m.bodies[0].touched, 0);
}

// A hand that comes back elsewhere has gone no way meanwhile.
TEST(Operation, AHandThatIsNotThereGoesNowhere) {
  Bar bar;
  Operation operation(*bar.world);
  bar.step(operation);
  bar.hand.present = false;
  bar.step(operation);
  bar.hand.pose.p.x() += 1;
  bar.hand.present = true;
  bar.step(operation);
  EXPECT_EQ(operation.measures().hands[0].path, 0);
}

// The fourth of eight cells goes: an eighth of the volume, and what was above is loose; then that is taken.
TEST(Operation, CountsVolumeAndPieces) {
  Bar bar;
  Operation operation(*bar.world);
  bar.step(operation);
  BodyMeasures body = operation.measures().bodies[0];
  EXPECT_NEAR(body.volume, 8e-6, 1e-15);
  EXPECT_EQ(body.volume_gone, 0);
  EXPECT_EQ(body.pieces, 1);
  EXPECT_EQ(body.loose, 0);
  bar.world->schedule_removal(0, bar.cell(3));
  bar.step(operation);
  body = operation.measures().bodies[0];
  EXPECT_NEAR(body.volume_gone, 1e-6, 1e-15);
  EXPECT_EQ(body.pieces, 2);
  EXPECT_EQ(body.loose, 1);
  for (const int k : {4, 5, 6, 7}) bar.world->schedule_removal(0, bar.cell(k));
  bar.step(operation);
  body = operation.measures().bodies[0];
  EXPECT_NEAR(body.volume_gone, 5e-6, 1e-15);
  EXPECT_EQ(body.pieces, 1);
  EXPECT_EQ(body.pieces_most, 2);
  EXPECT_EQ(body.loose, 0);
}

// Of a bar of 192 tetrahedra the last but one cell goes, and of the last all but one: a crumb, and no second
// piece.
TEST(Operation, WhatIsSmallerThanAHundredthIsACrumb) {
  BodySettings bar{"bar", true, box_mesh(Vec3(0.01, 0.01, 0.32), 1, 1, 32), {5000, 0.3, 1000, 5, 0.002}, {},
                   0,     true};
  bar.fixed_nodes = bar.mesh.group("bottom")->nodes;
  std::vector<int> gone;
  bool kept = false;
  for (int t = 0; t < static_cast<int>(bar.mesh.tets.size()); ++t) {
    double z = 0;
    for (const int n : bar.mesh.tets[t]) z += 0.25 * bar.mesh.nodes[n].z();
    if (z < 0.30 || (z > 0.31 && !std::exchange(kept, true))) continue;
    gone.push_back(t);
  }
  std::vector<BodySettings> bodies;
  bodies.push_back(std::move(bar));
  World world(std::move(bodies), ball(5e-3), settings());
  Operation operation(world);
  const auto problem = std::make_unique<CondensedProblem>();
  world.schedule_removal(0, gone);
  operation.follow(world, world.step([] { return InstrumentSamples(); }, *problem), InstrumentSamples(),
                   period);
  const BodyMeasures body = operation.measures().bodies[0];
  EXPECT_EQ(body.pieces, 1);
  EXPECT_EQ(body.pieces_most, 1);
  EXPECT_EQ(body.crumbs, 1);
  EXPECT_EQ(body.loose, 1);
}

// Pressed, what the body feels is what the hand feels, and the strain lies above the mean compression.
TEST(Operation, ATouchIsWhatTheHandFeels) {
  Bar bar;
  Operation operation(*bar.world);
  bar.hand.pose.p.z() = 0.08 + 5e-3 + 1e-3;
  for (int k = 0; k < 5; ++k) bar.step(operation);
  for (int k = 0; k < 50; ++k) {
    bar.hand.pose.p.z() -= 1e-4;
    bar.step(operation);
  }
  const OperationMeasures m = operation.measures();
  EXPECT_GT(m.hands[0].force_most, 0);
  EXPECT_NEAR(m.bodies[0].touch_most, m.hands[0].force_most, 1e-6 * m.hands[0].force_most);
  EXPECT_NEAR(m.bodies[0].touched, m.hands[0].touching, 1e-12);
  EXPECT_GT(m.bodies[0].strain_most, 0.01);
  EXPECT_LT(m.bodies[0].strain_most, 1);
  const nlohmann::ordered_json json = to_json(m);
  EXPECT_EQ(json["bodies"][0]["name"], "bar");
  EXPECT_EQ(json["hands"][0]["sim_force_most_n"], m.hands[0].force_most);
}

// A step that came late stands for as long as it took: the seconds are those of the hand.
TEST(Operation, CountsTheHandsOwnTime) {
  Bar bar;
  Operation operation(*bar.world);
  bar.hand.aspiration = true;
  for (const double elapsed : {0.02, 0.06, 0.04})
    operation.follow(*bar.world, {}, InstrumentSamples(bar.hand), elapsed);
  EXPECT_NEAR(operation.measures().time, 0.12, 1e-15);
  EXPECT_NEAR(operation.measures().hands[0].aspirating, 0.12, 1e-15);
}

TEST(SampleId, NamesItsBody) {
  for (const int body : {0, 1, 7, 200}) EXPECT_EQ(body_of_sample(sample_id(body, (1 << 20) + 5, 4095)), body);
  EXPECT_NE(sample_id(1, 2, 3), sample_id(1, 3, 2));
}

std::vector<std::string> told(const OperationMeasures& m) {
  std::vector<std::string> all;
  for (const OperationEvent& e : m.events) all.push_back(e.what);
  return all;
}

// An eighth goes, and the rest falls in two; then half of it all is gone, which is told once for each mark.
TEST(OperationEvents, PiecesAndVolumeAreToldOnce) {
  Bar bar;
  Operation operation(*bar.world);
  bar.step(operation);
  EXPECT_TRUE(operation.measures().events.empty());
  bar.world->schedule_removal(0, bar.cell(3));
  bar.step(operation);
  bar.step(operation);
  EXPECT_EQ(told(operation.measures()), std::vector<std::string>{"pieces"});
  EXPECT_EQ(operation.measures().events[0].who, "bar");
  EXPECT_EQ(operation.measures().events[0].value, 2);
  EXPECT_NEAR(operation.measures().events[0].time, 2 * period, 1e-12);
  for (const int k : {4, 5, 6}) bar.world->schedule_removal(0, bar.cell(k));
  bar.step(operation);
  bar.step(operation);
  EXPECT_EQ(told(operation.measures()), (std::vector<std::string>{"pieces", "gone", "gone"}));
  EXPECT_NEAR(operation.measures().events[2].value, 0.5, 1e-9);
}

// A pump that rises past four fifths, sinks a little, and falls below one: once occluded, once vented.
TEST(OperationEvents, APumpIsOccludedOnceAndVentedOnce) {
  Bar bar;
  Instrument port = ball(5e-3);
  port.port = {.radius = 1e-3, .reach = 1e-4, .vacuum = 1000, .rise_time = 0.1};
  std::vector<BodySettings> bodies;
  bodies.push_back({"floor", false, box_mesh(Vec3(0.01, 0.01, 0.01), 1, 1, 1), {}, {}, 0, false});
  World world(std::move(bodies), port, settings());
  OperationEvents events(world);
  const std::vector<BodyMeasures> measured(1);
  const std::vector<double> touch(1, 0.0);
  for (const double vacuum : {0.0, 700.0, 810.0, 900.0, 700.0, 300.0, 150.0, 500.0}) {
    InstrumentSample hand;
    hand.vacuum = vacuum;
    events.follow(0, world, {}, InstrumentSamples(hand), measured, touch);
  }
  ASSERT_EQ(events.all().size(), 2u);
  EXPECT_STREQ(events.all()[0].what, "occluded");
  EXPECT_STREQ(events.all()[1].what, "vented");
}

// A piece that takes three steps through the lumen is told when it is through, one of a single step is not;
// what is too wide is told again after half a second without.
TEST(OperationEvents, ALumenTellsWhatPassesAndWhatDoesNot) {
  std::vector<BodySettings> bodies;
  bodies.push_back({"floor", false, box_mesh(Vec3(0.01, 0.01, 0.01), 1, 1, 1), {}, {}, 0, false});
  World world(std::move(bodies), ball(5e-3), settings());
  OperationEvents events(world);
  const std::vector<BodyMeasures> measured(1);
  const std::vector<double> touch(1, 0.0);
  for (int k = 0; k < 100; ++k) {
    StepReport report;
    report.lumen[0].passing = (k >= 5 && k < 8) || k == 20 ? 1e-12 : 0;
    report.lumen[0].too_wide = (k > 30 && k < 40) || k == 45 || k == 90 ? 4e-4 : 0;
    events.follow(period * k, world, report, {}, measured, touch);
  }
  ASSERT_EQ(events.all().size(), 3u);
  EXPECT_STREQ(events.all()[0].what, "passed");
  EXPECT_EQ(events.all()[0].who, "0");
  EXPECT_NEAR(events.all()[0].value, 3 * period, 1e-12);
  EXPECT_STREQ(events.all()[1].what, "too_wide");
  EXPECT_EQ(events.all()[1].value, 4e-4);
  EXPECT_NEAR(events.all()[2].time, 90 * period, 1e-12);
}

// A shaft pressed against its ring far from any tissue touches nothing; the ring's force is what the hand
// feels.
TEST(Operation, MeasuresTheIncision) {
  std::vector<BodySettings> bodies;
  bodies.push_back({"floor", false, box_mesh(Vec3(0.01, 0.01, 0.01), 1, 1, 1), {}, {}, 0, false});
  Instrument shaft = ball(5e-3);
  shaft.incision = {Vec3(0, 0, 0.3), Vec3::UnitZ(), 1e-3, 500, 0};
  World world(std::move(bodies), shaft, settings());
  Operation operation(world);
  const auto problem = std::make_unique<CondensedProblem>();
  InstrumentSample hand = at(Vec3(0, 0, 0.2));
  StepReport report;
  for (int k = 0; k < 20; ++k) {
    hand.pose.p.x() = 0.5e-3 * std::min(k, 8);
    report = world.step([&] { return InstrumentSamples(hand); }, *problem);
    operation.follow(world, report, InstrumentSamples(hand), period);
  }
  const HandMeasures m = operation.measures().hands[0];
  EXPECT_GT(m.incision_force, 0);
  EXPECT_NEAR(m.incision_force, m.force_most, 1e-9 * m.force_most);
  EXPECT_NEAR(m.incision_stretch, m.incision_force / 500, 1e-9);
  EXPECT_EQ(m.touching, 0);
  EXPECT_EQ(operation.measures().bodies[0].touched, 0);
}

// What flows in while tissue covers a quarter of the port for a second, and all of it for another.
TEST(Operation, CountsTheFluidAndTheTimeOccluded) {
  Bar bar;
  Operation operation(*bar.world);
  bar.hand.aspiration = true;
  for (int k = 0; k < 100; ++k) {
    StepReport report;
    report.occlusion[0] = k < 50 ? 0.25 : 1;
    report.flow[0] = 4e-7 * (1 - report.occlusion[0]);
    operation.follow(*bar.world, report, InstrumentSamples(bar.hand), period);
  }
  const HandMeasures hand = operation.measures().hands[0];
  EXPECT_NEAR(hand.fluid, 3e-7, 1e-15);
  EXPECT_EQ(hand.flow, 0);
  EXPECT_NEAR(hand.occluded, 1, 1e-9);
  EXPECT_NEAR(hand.aspirating, 2, 1e-9);
}

// What the tip may not destroy is touched: told again only after half a second without.
TEST(OperationEvents, ATouchIsToldAgainAfterAWhile) {
  std::vector<BodySettings> bodies;
  bodies.push_back({"floor", false, box_mesh(Vec3(0.01, 0.01, 0.01), 1, 1, 1), {}, {}, 0, false});
  World world(std::move(bodies), ball(5e-3), settings());
  OperationEvents events(world);
  const std::vector<BodyMeasures> measured(1);
  for (int k = 0; k < 100; ++k) {
    const bool touched = k < 10 || (k > 15 && k < 20) || k > 60;
    events.follow(period * k, world, {}, {}, measured, {touched ? 0.1 : 0.0});
  }
  EXPECT_EQ(events.all().size(), 2u);
}

}  // namespace
}  // namespace hapticd
