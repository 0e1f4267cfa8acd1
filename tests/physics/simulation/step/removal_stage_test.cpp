// What a step removes: at the rate, from where the tip is, and what was scheduled.
#include "physics/simulation/step/removal_stage.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

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

// 250 a second of a body of equal tetrahedra: each step takes five of them, in equal shares of those that the
// tip meets, until a tenth of each is left; all go in the step after that.
TEST_F(Carving, ByDegreesTheTipTakesItsRateFromAllThatItMeets) {
  RemovalStage stage(RemovalSettings{.rate = 250, .stroke = 1e-4, .gradual = true}, h, 1);
  const TissueModel& model = bodies[0].model;
  const auto n = static_cast<int>(tets_at_tip(model, bodies[0].state, instrument, inside.pose, 1e-4).size());
  ASSERT_GT(n, 8);
  const auto volume = [&] {
    double sum = 0;
    for (int t = 0; t < model.tet_count(); ++t) sum += volume_left(model, bodies[0].state, t);
    return sum;
  };
  const double per_step = 250 * h * bodies[0].mean_volume;
  int steps = 0;
  for (double before = volume(); remove(stage, inside).tets == 0; before = volume()) {
    EXPECT_EQ(stage.thin(bodies, instrument, inside, inside.pose, h), std::vector<int>{0});
    if (++steps < static_cast<int>(0.9 * n / 5)) {
      EXPECT_NEAR(before - volume(), per_step, 1e-9 * per_step);
    }
    ASSERT_LT(steps, 1000);
  }
  EXPECT_EQ(steps, static_cast<int>(std::ceil(0.9 * n / 5)));
  EXPECT_GE(stage.total(), n);
}

// Two tips at one place take twice as much in a step, and what was less stays less.
TEST_F(Carving, ByDegreesEachTipTakesItsOwn) {
  EachInstrument<RemovalSettings> settings;
  settings[0] = settings[1] = RemovalSettings{.rate = 250, .stroke = 1e-4, .gradual = true};
  RemovalStage two(settings, h, 1);
  const std::vector<Instrument> tips = {instrument, instrument};
  InstrumentSamples samples;
  InstrumentPoses poses;
  samples[0] = samples[1] = inside;
  poses = poses_of(samples);
  const std::vector<int> met = tets_at_tip(bodies[0].model, bodies[0].state, instrument, inside.pose, 1e-4);
  two.thin(bodies, tips, samples, poses, h);
  const int t = met.front();
  const double share = 250 * h * bodies[0].mean_volume / static_cast<double>(met.size());
  EXPECT_NEAR(bodies[0].state.left[t], 1 - 2 * share / bodies[0].model.volume[t], 1e-12);
  const double left = bodies[0].state.left[t];
  two.schedule_thinning(0, std::vector<int>{t}, 10, 0);
  two.thin(bodies, tips, {}, {}, h);
  EXPECT_EQ(bodies[0].state.left[t], left);
}

// What tips take in a step goes before it begins, or with its begin: the rate is the same, and what they have
// spent by degrees goes too. What was scheduled waits for the begin.
TEST_F(Carving, WhatTheTipsTakeMayGoBeforeTheStep) {
  RemovalStage stage(RemovalSettings{.rate = 125, .stroke = 1e-4}, h, 1);
  const auto ahead = [&](RemovalStage& s) { return s.remove_ahead(bodies, instrument, inside, inside.pose); };
  std::vector<int> per_step;
  for (int i = 0; i < 4; ++i) {
    per_step.push_back(ahead(stage).tets);
    EXPECT_EQ(remove(stage, inside).tets, 0) << "they were taken";
  }
  EXPECT_EQ(per_step, (std::vector<int>{2, 3, 2, 3}));
  EXPECT_EQ(remove(stage, inside).tets, 2) << "of a step that was not begun ahead";
  const auto last =
      static_cast<int>(std::find(bodies[0].state.alive.begin(), bodies[0].state.alive.end(), 1) -
                       bodies[0].state.alive.begin());
  stage.schedule(0, {last});
  ahead(stage);
  EXPECT_TRUE(bodies[0].state.alive[last]);
  EXPECT_EQ(remove(stage, inside).tets, 1);

  RemovalStage by_degrees(RemovalSettings{.rate = 1e5, .stroke = 1e-4, .gradual = true}, h, 1);
  by_degrees.thin(bodies, instrument, inside, inside.pose, h);
  const std::vector<int> met = tets_at_tip(bodies[0].model, bodies[0].state, instrument, inside.pose, 1e-4);
  const Removed spent = ahead(by_degrees);
  EXPECT_TRUE(spent.by_tips);
  EXPECT_GE(spent.tets, std::ssize(met));
  EXPECT_EQ(std::ssize(by_degrees.gone()[0]), spent.tets);
  for (const int t : met) EXPECT_FALSE(bodies[0].state.alive[t]);
  EXPECT_EQ(remove(by_degrees, inside).tets, 0);
}

TEST_F(Carving, ByDegreesNothingGoesWithoutThePedal) {
  RemovalStage stage(RemovalSettings{.rate = 250, .stroke = 1e-4, .gradual = true}, h, 1);
  InstrumentSample up = inside;
  up.phaco = false;
  EXPECT_TRUE(stage.thin(bodies, instrument, up, up.pose, h).empty());
  EXPECT_TRUE(stage.thin(bodies, instrument, outside, outside.pose, h).empty());
}

// left(t) = 1 − (t − begin)/time, in the middle of the problem's use, down to what goes.
TEST_F(Carving, WhatIsScheduledToBecomeLessDoesSoEvenly) {
  RemovalStage stage(RemovalSettings{}, h, 1);
  stage.schedule_thinning(0, std::vector<int>{4, 7}, 0.2, -5e-3);
  for (int k = 0; k < 12; ++k) {
    EXPECT_EQ(remove(stage, {}).tets, 0);
    stage.thin(bodies, instrument, {}, {}, 0.018);
    const double expected = std::clamp(1 - (k * h + 0.018 - 5e-3) / 0.2, spent_left, 1.0);
    EXPECT_NEAR(bodies[0].state.left[4], expected, 1e-12);
    EXPECT_EQ(bodies[0].state.left[7], bodies[0].state.left[4]);
  }
  stage.schedule(0, {4, 7});
  EXPECT_EQ(remove(stage, {}).tets, 2);
  EXPECT_TRUE(stage.thin(bodies, instrument, {}, {}, 0.018).empty());
}

// Two loose crumbs before a port: the second waits until the first one's volume has gone through at the
// pump's flow; without a flow nothing waits.
TEST(Aspiration, PiecesGoThroughTheLumenOneAfterAnother) {
  for (const double flow : {0.0, 1e-11, 2.5e-11}) {
    BodySettings settings{
        "bar", true, box_mesh(Vec3(5e-4, 1e-4, 1e-4), 5, 1, 1), {5000, 0.4, 1000, 5, 0.002}, {}, 0, true};
    Bodies bodies;
    bodies.emplace_back(std::move(settings), h, Vec3::Zero());
    std::vector<int> gap;  // the second and fourth of five cells; the last is out of reach
    for (int t = 0; t < bodies[0].model.tet_count(); ++t) {
      double x = 0;
      for (const int n : bodies[0].model.mesh.tets[t]) x += 0.25e4 * bodies[0].rest()[n].x();
      if (static_cast<int>(x) % 2 == 1) gap.push_back(t);
    }
    Instrument instrument;
    Primitive tip;
    tip.shape = Shape::sphere;
    tip.radius = 1e-5;
    instrument.primitives = {tip};
    instrument.port = {.radius = 1e-5, .reach = 1e-5, .flow = flow, .lumen = 1e-4};
    InstrumentSample sample;
    sample.present = sample.aspiration = true;
    sample.pose.p = Vec3(-0.5e-4, 0.5e-4, 0.5e-4);
    RemovalStage stage(RemovalSettings{.aspiration_reach = 2e-4}, h, 1);
    stage.schedule(0, gap);
    Removed removed = stage.remove(bodies, instrument, sample, sample.pose);
    EXPECT_EQ(removed.fragments_aspirated, 1);
    EXPECT_NEAR(removed.lumen[0].passing, 1e-12, 1e-18);
    sample.pose.p.x() = 1.5e-4;
    // 1e-12 m³ are through in 100 and 40 ms, in the fifth and second step.
    const int wait = flow == 0 ? 0 : static_cast<int>(std::ceil(1e-12 / (flow * h) - 1e-9)) - 1;
    double through = 0;
    for (int i = 0; i < wait; ++i) {
      removed = stage.remove(bodies, instrument, sample, sample.pose);
      EXPECT_EQ(removed.fragments_aspirated, 0) << flow;
      through += removed.passed[0];
      EXPECT_NEAR(removed.lumen[0].passing, 1e-12 - through, 1e-18);
    }
    removed = stage.remove(bodies, instrument, sample, sample.pose);
    EXPECT_EQ(removed.fragments_aspirated, 1) << flow;
    EXPECT_NEAR(through + removed.passed[0], 1e-12, 1e-18);
  }
}

}  // namespace
}  // namespace hapticd
