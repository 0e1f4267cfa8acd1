// What a step removes: at the rate, from where the tip is, and what was scheduled.
#include "physics/simulation/step/removal_stage.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;

class Carving : public testing::Test {
 protected:
  Carving() {
    BodySettings b{"block", true, box_mesh(Vec3(0.02, 0.02, 0.02), 5, 5, 5), {5000, 0.4, 1000, 5, 0.002}, {},
                   0,       true};
    b.fixed_nodes = b.mesh.group("bottom")->nodes;
    bodies.emplace_back(std::move(b), h, Vec3::Zero());
    Primitive tip;
    tip.shape = Shape::sphere;
    tip.radius = 6e-3;
    instrument.primitives = {tip};
    inside.pose.p = Vec3(0.01, 0.01, 0.02);
    inside.present = inside.phaco = true;
    outside = inside;
    outside.pose.p.z() = 1;
  }

  Removed remove(RemovalStage& stage, const InstrumentSample& sample) {
    return stage.remove(bodies, instrument, sample, sample.pose);
  }

  Bodies bodies;
  Instrument instrument;
  InstrumentSample inside, outside;
};

// 125 a second at 50 Hz are 2.5 a step: five in two steps, after the first whole one.
TEST_F(Carving, ElementsGoAtTheRate) {
  RemovalStage stage(RemovalSettings{.rate = 125, .stroke = 1e-4}, h, 1);
  std::vector<int> per_step;
  for (int i = 0; i < 4; ++i) per_step.push_back(remove(stage, inside).tets);
  EXPECT_EQ(per_step, (std::vector<int>{2, 3, 2, 3}));
  EXPECT_EQ(stage.total(), 10);
  EXPECT_EQ(stage.gone()[0].size(), 10u);
  EXPECT_TRUE(std::none_of(stage.gone()[0].begin(), stage.gone()[0].end(),
                           [&](int t) { return bodies[0].state.alive[t] != 0; }));
}

TEST_F(Carving, ATipInTheOpenSavesNothingUp) {
  RemovalStage stage(RemovalSettings{.rate = 125, .stroke = 1e-4}, h, 1);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(remove(stage, outside).tets, 0);
  EXPECT_LE(remove(stage, inside).tets, 3);
}

TEST_F(Carving, WhatWasScheduledGoesOnceWhateverTheTipDoes) {
  RemovalStage stage(RemovalSettings{.rate = 125, .stroke = 1e-4}, h, 1);
  bodies[0].asleep = bodies[0].free.ahead = true;
  stage.schedule(0, {1, 5, 5});
  const Removed removed = remove(stage, {});
  EXPECT_EQ(removed.tets, 2);
  EXPECT_EQ(removed.bodies, std::vector<int>{0});
  EXPECT_FALSE(bodies[0].asleep);
  EXPECT_TRUE(bodies[0].free.ahead) << "until its compliance is told";
  stage.tell_compliances(bodies);
  EXPECT_FALSE(bodies[0].free.ahead);
  EXPECT_TRUE(stage.gone()[0].empty());
  EXPECT_EQ(remove(stage, {}).tets, 0);
}

}  // namespace
}  // namespace hapticd
