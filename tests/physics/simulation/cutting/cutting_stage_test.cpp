// A blade in a block, with hand answers: below J w it is a contact, above it the hand feels J w.
#include "physics/simulation/cutting/cutting_stage.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include <gtest/gtest.h>

#include "physics/simulation/world.h"
#include "physics/tissue/fragments.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double toughness = 1, h = 0.02;  // J/m², s
const Vec3 size(12e-3, 6e-3, 5e-3);        // the block

// A level edge across the whole block, wider than it, that cuts downwards; the sheet stands above it.
Instrument knife() {
  Instrument i;
  i.blade = make_blade({Vec3(0, -4e-3, 0), Vec3(0, 4e-3, 0)}, Vec3(0, 0, -1), 16);
  std::vector<Vec3> corners;
  for (const double x : {-0.05e-3, 0.05e-3})
    for (const double y : {-4e-3, 4e-3})
      for (const double z : {3e-3, 10e-3}) corners.push_back(Vec3(x, y, z));
  i.primitives = {make_convex("sheet", corners, {})};
  return i;
}

BodySettings block(int new_nodes, double viscosity) {
  BodySettings b{"block", true, box_mesh(size, 8, 4, 4, 5), {5000, 0.4, 1000, 5, 0.002}, {}, 0, false};
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  b.toughness = toughness;
  b.cutting_viscosity = viscosity;
  b.room = {new_nodes, 6 * new_nodes};
  return b;
}

class KnifeInBlock : public testing::Test {
 protected:
  void make(int new_nodes, double viscosity = 0) {
    WorldSettings settings;
    settings.h = h;
    settings.alarm_distance = 1.5e-3;
    settings.sample_spacing = 1e-3;
    settings.coupling[0] = {500, 0.05, 0};
    world_.emplace(std::vector<BodySettings>{block(new_nodes, viscosity)}, knife(), settings);
  }
  // The edge's height above the block's top; returns the force on the hand, upwards [N].
  double step(double above) {
    const InstrumentSample sample{
        {Vec3(size.x() / 2 + 0.1e-3, size.y() / 2, size.z() + above), Quat::Identity()}, present_};
    report_ = world_->step([&] { return InstrumentSamples(sample); }, *problem_);
    return report_.contact.wrench[0].z();
  }
  // From one height to another at so many metres a second; the forces on the way.
  std::vector<double> go(double from, double to, double speed) {
    std::vector<double> force;
    const int steps = static_cast<int>(std::ceil(std::abs(to - from) / (speed * h)));
    for (int k = 1; k <= steps; ++k) force.push_back(step(from + (to - from) * k / steps));
    return force;
  }
  const TissueModel& model() const { return world_->bodies()[0].model; }

  std::optional<World> world_;
  std::unique_ptr<CondensedProblem> problem_ = std::make_unique<CondensedProblem>();
  StepReport report_;
  bool present_ = true;
};

TEST_F(KnifeInBlock, BelowItsToughnessTheEdgeIsAContact) {
  make(500);
  const int nodes = model().nodes_in_use;
  go(1e-3, -0.1e-3, 10e-3);
  double force = 0;
  for (int k = 0; k < 50; ++k) force = step(-0.1e-3);
  EXPECT_GT(force, 0);
  EXPECT_LT(force, toughness * size.y());
  EXPECT_EQ(model().nodes_in_use, nodes);
  EXPECT_EQ(world_->cutting().area(), 0);
  go(-0.1e-3, 1e-3, 10e-3);
  EXPECT_LT((world_->bodies()[0].state.x.back() - world_->bodies()[0].rest().back()).norm(), 1e-4)
      << "it springs back";
}

TEST_F(KnifeInBlock, AboveItTheHandFeelsToughnessTimesWidth) {
  make(500);
  go(1e-3, -1.5e-3, 10e-3);
  const std::vector<double> force = go(-1.5e-3, -3.5e-3, 10e-3);
  double mean = 0;
  for (const double f : force) mean += f / static_cast<double>(force.size());
  // Twelve of sixteen samples are above the block: 6 of 8 mm.
  EXPECT_NEAR(mean, toughness * size.y(), 0.03 * toughness * size.y());
  EXPECT_NEAR(world_->cutting().area(), size.y() * 3.5e-3, 0.15 * size.y() * 3.5e-3);
  EXPECT_GT(model().nodes_in_use, 9 * 5 * 5);
  EXPECT_FALSE(report_.out_of_room);
}

// c = 50 N·s/m²: at 10 mm/s half of the toughness's force comes to it.
TEST_F(KnifeInBlock, AViscousCutCostsMoreByItsSpeed) {
  for (const double speed : {5e-3, 10e-3}) {
    make(500, 50);
    go(1e-3, -1.5e-3, speed);
    const std::vector<double> force = go(-1.5e-3, -3.5e-3, speed);
    double mean = 0;
    for (const double f : force) mean += f / static_cast<double>(force.size());
    const double expected = (toughness + 50 * speed) * size.y();
    EXPECT_NEAR(mean, expected, 0.03 * expected) << speed;
  }
}

TEST_F(KnifeInBlock, ItsForceGoesAtOnceWhenItWithdrawsAndTheCutStays) {
  make(500);
  go(1e-3, -2e-3, 10e-3);
  const double area = world_->cutting().area();
  go(-2e-3, -1e-3, 10e-3);
  EXPECT_NEAR(step(-1e-3), 0, 0.05 * toughness * size.y());
  EXPECT_EQ(world_->cutting().area(), area);
  const std::vector<double> again = go(-1e-3, -1.6e-3, 10e-3);
  for (const double f : again) EXPECT_LT(f, 0.5 * toughness * size.y()) << "nothing has healed";
}

// A device that is silent for some steps has neither force nor lost its cut.
TEST_F(KnifeInBlock, ASilentDeviceGoesOnWithItsCut) {
  make(500);
  go(1e-3, -1.5e-3, 10e-3);
  present_ = false;
  for (const double f : go(-1.5e-3, -2.1e-3, 10e-3)) EXPECT_EQ(f, 0);
  present_ = true;
  go(-2.1e-3, -2.5e-3, 10e-3);
  double mean = 0;
  for (const double f : go(-2.5e-3, -3.5e-3, 10e-3)) mean += f / 5;
  EXPECT_NEAR(mean, toughness * size.y(), 0.03 * toughness * size.y());
  EXPECT_NEAR(world_->cutting().area(), size.y() * 3.5e-3, 0.15 * size.y() * 3.5e-3);
}

// One that comes back farther on, or first appears inside, cuts from there.
TEST_F(KnifeInBlock, ABladeThatIsInsideCutsFromWhereItIs) {
  make(500);
  step(-2e-3);
  EXPECT_LT(std::abs(step(-2e-3)), 0.05 * toughness * size.y());
  go(-2e-3, -2.5e-3, 10e-3);
  double mean = 0;
  for (const double f : go(-2.5e-3, -3.5e-3, 10e-3)) mean += f / 5;
  EXPECT_NEAR(mean, toughness * size.y(), 0.03 * toughness * size.y());
  EXPECT_LT(world_->cutting().area(), size.y() * 1.6e-3);
}

TEST_F(KnifeInBlock, CutThroughItIsTwoPieces) {
  make(500);
  go(1e-3, -4.2e-3, 10e-3);  // not through the bottom, which is held
  const std::vector<int> label = label_fragments(model(), world_->bodies()[0].state);
  // Above four fifths of the depth nothing joins the sides: no element has nodes on both.
  for (int t = 0; t < model().tets_in_use; ++t) {
    bool left = false, right = false, high = true;
    for (const int n : model().mesh.tets[t]) {
      const Vec3& X = model().mesh.nodes[n];
      left = left || X.x() < size.x() / 2 - 0.8e-3;
      right = right || X.x() > size.x() / 2 + 1.0e-3;
      high = high && X.z() > 0.4 * size.z();
    }
    EXPECT_FALSE(left && right && high) << t;
  }
  EXPECT_GE(*std::max_element(label.begin(), label.end()), 0);
}

TEST_F(KnifeInBlock, WithoutRoomTheTissueStaysAsItIsAndTheStepSaysSo) {
  make(3);
  go(1e-3, -3e-3, 10e-3);
  EXPECT_TRUE(report_.out_of_room);
  EXPECT_LE(model().nodes_in_use, 9 * 5 * 5 + 3);
  for (const Vec3& x : world_->bodies()[0].state.x) ASSERT_TRUE(x.allFinite());
}

TEST_F(KnifeInBlock, WithoutABladeNothingIsCut) {
  WorldSettings settings;
  settings.h = h;
  settings.alarm_distance = 1.5e-3;
  settings.sample_spacing = 1e-3;
  settings.coupling[0] = {500, 0.05, 0};
  Instrument ball;
  Primitive tip;
  tip.radius = 1e-3;
  ball.primitives = {tip};
  world_.emplace(std::vector<BodySettings>{block(500, 0)}, ball, settings);
  go(2e-3, -1e-3, 10e-3);
  EXPECT_EQ(model().nodes_in_use, 9 * 5 * 5);
  EXPECT_EQ(problem_->edges, 0);
}

}  // namespace
}  // namespace hapticd
