// A pressed body that loses elements: what a step publishes at once, and a refresh afterwards.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <utility>

#include "physics/simulation/world.h"
#include "tests/physics/simulation/step/soft_block.h"

namespace hapticd {
namespace {

using namespace soft_block_bench;

class PressedWorld : public testing::Test {
 protected:
  static InstrumentSample sample() { return {{Vec3(0.01, 0.01, 0.0215), Quat::Identity()}, true}; }

  static std::unique_ptr<World> world(bool corotational, const BodySettings* second = nullptr,
                                      const RemovalSettings& removal = {},
                                      std::vector<ContactPair> pairs = {}, const Port& port = {}) {
    WorldSettings s;
    s.removal[0] = removal;
    s.body_contact.pairs = std::move(pairs);
    s.h = h;
    s.alarm_distance = 3e-3;
    s.sample_spacing = 1e-3;
    s.coupling[0] = {500, 0.05, 0};
    s.lead = 0.9 * h;
    Instrument instrument;
    Primitive tip;
    tip.shape = Shape::sphere;
    tip.radius = 3e-3;
    instrument.primitives = {tip};
    instrument.port = port;
    std::vector<BodySettings> bodies;
    bodies.push_back(soft_block(6, corotational));
    bodies[0].friction = 0;
    if (second) bodies.push_back(*second);
    return std::make_unique<World>(std::move(bodies), instrument, s);
  }

  // The six nearest to the tip.
  static std::vector<int> under_tip(const World& w) {
    const Body& body = w.bodies()[0];
    std::vector<std::pair<double, int>> all;
    for (int t = 0; t < body.model.tet_count(); ++t) {
      Vec3 c = Vec3::Zero();
      for (const int n : body.model.mesh.tets[t]) c += 0.25 * body.state.x[n];
      all.emplace_back((c - sample().pose.p).norm(), t);
    }
    std::sort(all.begin(), all.end());
    std::vector<int> nearest;
    for (int k = 0; k < 6; ++k) nearest.push_back(all[k].second);
    return nearest;
  }

  std::unique_ptr<CondensedProblem> first = std::make_unique<CondensedProblem>(),
                                    second = std::make_unique<CondensedProblem>();
  int published = 0;

  StepReport step(World& w, double vacuum = 0) {
    InstrumentSample now = sample();
    now.vacuum = vacuum;
    return w.step([&] { return now; }, *first,
                  [&]() -> CondensedProblem& {
                    ++published;
                    return *second;
                  });
  }
};

// Steps in which nothing can touch another are those of a world that names no pair: looked ahead, to the bit.
TEST_F(PressedWorld, APairThatIsFarApartChangesNothing) {
  BodySettings far = soft_block(3, true);
  for (Vec3& x : far.mesh.nodes) x.x() += 1;
  const auto alone = world(true, &far);
  const auto paired = world(true, &far, {}, {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}});
  const auto other = std::make_unique<CondensedProblem>();
  for (int i = 0; i < 30; ++i) {
    if (i == 20)
      for (World* w : {alone.get(), paired.get()}) w->schedule_removal(0, under_tip(*w));
    const StepReport a = step(*alone);
    const int nodes = first->nodes;
    *other = *first;
    const StepReport b = step(*paired);
    ASSERT_EQ(nodes, first->nodes);
    const MatX C = first->C();
    EXPECT_TRUE(C == other->C()) << i << ": " << (C - other->C()).norm() / C.norm();
    double apart = 0;
    for (int n = 0; n < nodes; ++n) apart = std::max(apart, (other->x_free[n] - first->x_free[n]).norm());
    EXPECT_EQ(apart, 0) << i;
    EXPECT_EQ(a.contact.wrench[0], b.contact.wrench[0]) << i;
    EXPECT_EQ(a.interim, b.interim);
    EXPECT_EQ(alone->wants_refresh(), paired->wants_refresh());
  }
}

// With suction a step solves twice, the first time to see where it draws.
TEST_F(PressedWorld, APairThatIsFarApartChangesNothingUnderSuction) {
  BodySettings far = soft_block(3, true);
  for (Vec3& x : far.mesh.nodes) x.x() += 1;
  Port port;
  port.position = Vec3(0, 0, -3e-3);
  port.radius = 2e-3;
  port.reach = 1e-3;
  port.vacuum = 3e3;
  const auto alone = world(true, &far, {}, {}, port);
  const auto paired = world(true, &far, {}, {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}}, port);
  for (int i = 0; i < 20; ++i) {
    const StepReport a = step(*alone, port.vacuum), b = step(*paired, port.vacuum);
    EXPECT_GT(a.occlusion[0], 0.1) << i;
    EXPECT_EQ(a.occlusion[0], b.occlusion[0]) << i;
    EXPECT_EQ(a.contact.wrench[0], b.contact.wrench[0]) << i;
  }
}

// A crumb at the edge of a port's reach is drawn under it, which throws it deep into the block; what that
// would bring into touch is not looked for, as it is to be let go.
TEST_F(PressedWorld, WhatIsToBeLetGoJoinsNothing) {
  BodySettings crumb = soft_block(1, true);
  crumb.fixed_nodes.clear();
  for (Vec3& x : crumb.mesh.nodes) x = Vec3(0.0131, 0.0099, 0.0228) + 0.01 * x;
  Port port;
  port.position = Vec3(3.2e-3, 0, 0.9e-3);
  port.direction = Vec3(0, 0, 1);
  port.radius = 0.5e-3;
  port.reach = 0.5e-3;
  port.vacuum = 0.5;
  const auto w = world(true, &crumb, {}, {{1, 0, 0}, {0, 1, 0}}, port);
  const Vec3 before = w->bodies()[1].state.x[0];
  const StepReport r = step(*w, port.vacuum);
  EXPECT_GT(r.contact.active, 0);
  EXPECT_EQ(r.occlusion[0], 0);
  EXPECT_EQ(r.body_contact.joined, 0);
  EXPECT_EQ(w->bodies()[1].state.x[0], before);
}

TEST_F(PressedWorld, PublishesAtOnceWhatItRemovesAndOnlyThen) {
  for (const bool corotational : {false, true}) {
    const auto w = world(corotational);
    published = 0;
    StepReport report;
    for (int i = 0; i < 40; ++i) report = step(*w);
    EXPECT_EQ(published, 0);
    EXPECT_FALSE(report.interim);
    const Vec3 before = report.contact.wrench[0].head<3>();
    EXPECT_GT(before.z(), 1e-3);
    const std::uint64_t last = first->step;

    const std::vector<int> gone = under_tip(*w);
    w->schedule_removal(0, gone);
    report = step(*w);
    EXPECT_EQ(published, 1);
    EXPECT_TRUE(report.interim);
    EXPECT_EQ(first->step, last + 1);
    EXPECT_EQ(second->step, last + 2);
    EXPECT_TRUE(first->topology_changed);
    EXPECT_FALSE(second->topology_changed) << "since the interim problem nothing went";
    ASSERT_GT(first->samples, 0);
    ASSERT_EQ(first->samples, second->samples);
    for (int k = 0; k < first->samples; ++k) {
      const auto tet =
          static_cast<int>(first->sample[k].id >> 14);  // a face is 4 tet + side, a sample 4096 of it
      EXPECT_EQ(std::count(gone.begin(), gone.end(), tet), 0);
      EXPECT_EQ(first->sample[k].id, second->sample[k].id);
    }
    // The step's own solve is of the same system at the same pose, linearised where the body is.
    ContactState state;
    const auto scratch = std::make_unique<ContactScratch>();
    ContactOptions options;
    options.linearisations = 8;
    options.margin = contact_margin * 3e-3;
    const Vec3 interim = solve_contact(*first, w->instruments(), sample().pose, h, options, state, *scratch)
                             .wrench[0]
                             .head<3>();
    const Vec3 own = report.contact.wrench[0].head<3>();
    EXPECT_LT((interim - own).norm(), (corotational ? 1e-2 : 1e-3) * own.norm());
    EXPECT_GT((before - own).norm(), 0.05 * before.norm()) << "it was worth an interim problem";
    EXPECT_FALSE(step(*w).interim);
  }
}

// The tip presses two blocks, which stand in one another as bodies without a pair may; one of them loses
// elements.
TEST_F(PressedWorld, WhatAnotherBodyLosesLeavesAPressedBodysProblemAlone) {
  BodySettings other = soft_block(9, true);  // so fine that Eigen takes its products in blocks
  other.name = "other";
  other.removable = false;
  other.material.rayleigh_stiffness = 0;  // or its x_free would be moved with x_now
  for (Vec3& x : other.mesh.nodes) x.x() += 0.012;
  const auto w = world(true, &other);
  for (int i = 0; i < 40; ++i) step(*w);
  const auto before = std::make_unique<CondensedProblem>(*first);
  w->schedule_removal(0, under_tip(*w));
  ASSERT_TRUE(step(*w).interim);

  // Its samples by name, and through them its nodes in both problems.
  std::vector<std::pair<int, int>> node;  // in the problem before, in the interim one
  for (int k = 0; k < before->samples; ++k)
    for (int j = 0; j < first->samples; ++j)
      if (before->sample[k].id >> 56 == 1 && before->sample[k].id == first->sample[j].id)
        for (int c = 0; c < 3; ++c) node.emplace_back(before->sample[k].node[c], first->sample[j].node[c]);
  ASSERT_GE(node.size(), 9u);
  double most = 0;
  for (const auto& [i, m] : node) {
    EXPECT_LT((before->x_free[i] - first->x_free[m]).norm(), 1e-12);
    for (const auto& [j, n] : node) {
      const Mat3 C = before->C().block<3, 3>(3 * i, 3 * j);
      most = std::max(most, C.norm());
      EXPECT_LT((C - first->C().block<3, 3>(3 * m, 3 * n)).norm(), 1e-10 * most);
    }
  }
  EXPECT_GT(most, 0);
}

// What is under the tip becomes less in 0.4 s, then goes: the force falls in every step, by little, and what
// goes at last takes less of it than what goes at once. No step but the last has an interim problem.
TEST_F(PressedWorld, ByDegreesTheForceFallsByDegrees) {
  const auto w = world(true);
  StepReport report;
  for (int i = 0; i < 40; ++i) report = step(*w);
  const double before = report.contact.wrench[0].z();
  const std::vector<int> under = under_tip(*w);
  w->schedule_thinning(0, under, 0.4, 0);
  const Body& body = w->bodies()[0];
  std::vector<double> force = {before};
  for (int i = 0; i < 19; ++i) {
    report = step(*w);
    EXPECT_FALSE(report.interim);
    force.push_back(report.contact.wrench[0].z());
  }
  for (std::size_t i = 2; i < force.size(); ++i) {
    EXPECT_LT(force[i], force[i - 1]) << i;
    EXPECT_GT(force[i], 0.98 * force[i - 1]) << i;
  }
  EXPECT_LT(force.back(), 0.9 * before);
  for (const int t : under) EXPECT_NEAR(body.state.left[t], spent_left, 1e-12);
  w->schedule_removal(0, under);
  report = step(*w);
  EXPECT_TRUE(report.interim);
  const double last = force.back() - report.contact.wrench[0].z();

  const auto at_once = world(true);
  for (int i = 0; i < 40; ++i) step(*at_once);
  at_once->schedule_removal(0, under);
  EXPECT_LT(last, 0.75 * (before - step(*at_once).contact.wrench[0].z()));
}

// A problem says that its tissue became less, be it a refreshed one: the haptic loop blends by that.
TEST_F(PressedWorld, TellsThatTissueBecameLess) {
  const auto w = world(true, nullptr, {.rate = 100, .stroke = 1e-3, .gradual = true});
  for (int i = 0; i < 40; ++i) step(*w);
  EXPECT_FALSE(first->thinned);
  InstrumentSample carving = sample();
  carving.phaco = true;
  w->step([&] { return carving; }, *first);
  EXPECT_TRUE(first->thinned);
  EXPECT_FALSE(first->topology_changed);
  w->schedule_removal(0, under_tip(*w));
  w->step([&] { return carving; }, *first);
  EXPECT_TRUE(first->thinned);
  EXPECT_TRUE(first->topology_changed);
  carving.pose.p += Vec3(0.5e-3, 0, -0.5e-3);
  const auto refreshed = std::make_unique<CondensedProblem>();
  ASSERT_TRUE(w->refresh(carving, *refreshed));
  EXPECT_TRUE(refreshed->thinned);
  step(*w);
  step(*w);
  EXPECT_FALSE(first->thinned) << "nothing becomes less now";
}

// What the tip takes goes with the problem that the step before ends with: that is the system without it, and
// nobody waits for an interim problem. Not so one element a step or fewer, nor a linear body's, which is
// linearised once: they go when their step begins.
TEST_F(PressedWorld, WhatTheTipTakesGoesWithTheProblemOfTheStepBefore) {
  for (const auto& [corotational, rate] : {std::pair(false, 100.0), {true, 50.0}, {true, 100.0}}) {
    const bool ahead = corotational && rate > 50;
    const auto w = world(corotational, nullptr, {.rate = rate, .stroke = 1e-3});
    published = 0;
    for (int i = 0; i < 40; ++i) step(*w);
    InstrumentSample carving = sample();
    carving.phaco = true;
    const StepReport report = w->step([&] { return carving; }, *first,
                                      [&]() -> CondensedProblem& {
                                        ++published;
                                        return *second;
                                      });
    ASSERT_GT(report.removed, 0);
    EXPECT_EQ(report.removed_ahead, ahead ? report.removed : 0);
    EXPECT_EQ(published, ahead ? 0 : 1);
    EXPECT_EQ(report.interim, !ahead);
    if (!ahead) continue;
    EXPECT_TRUE(first->topology_changed);
    const Body& body = w->bodies()[0];
    ASSERT_GT(first->samples, 0);
    for (int k = 0; k < first->samples; ++k)
      EXPECT_TRUE(body.state.alive[static_cast<std::size_t>(first->sample[k].id >> 14)]);

    ContactState state;
    const auto scratch = std::make_unique<ContactScratch>();
    ContactOptions options;
    options.linearisations = 8;
    options.margin = contact_margin * 3e-3;
    const Vec3 told = solve_contact(*first, w->instruments(), sample().pose, h, options, state, *scratch)
                          .wrench[0]
                          .head<3>();
    const StepReport next = step(*w);
    EXPECT_EQ(next.removed, 0);
    EXPECT_FALSE(first->topology_changed);
    const Vec3 own = next.contact.wrench[0].head<3>();
    EXPECT_GT(own.norm(), 1e-3);
    EXPECT_LT((told - own).norm(), 1e-2 * own.norm());
  }
}

// The tip goes on sideways after the step in which elements went.
TEST_F(PressedWorld, IsRefreshedForWhereTheInstrumentIsAfterARemovalAlone) {
  const auto w = world(true);
  for (int i = 0; i < 40; ++i) step(*w);
  const auto refreshed = std::make_unique<CondensedProblem>();
  InstrumentSample moved = sample();
  moved.pose.p += Vec3(0.5e-3, 0, -0.5e-3);
  EXPECT_FALSE(w->refresh(moved, *refreshed)) << "nothing went";
  w->schedule_removal(0, under_tip(*w));
  step(*w);
  ASSERT_TRUE(w->refresh(moved, *refreshed));
  EXPECT_EQ(refreshed->step, second->step + 1);
  EXPECT_FALSE(refreshed->topology_changed);
  ASSERT_EQ(refreshed->nodes, second->nodes);
  ASSERT_EQ(refreshed->samples, second->samples);
  for (int n = 0; n < refreshed->nodes; ++n) EXPECT_EQ(refreshed->x_now[n], second->x_now[n]);

  // Newton's method: what is left to change is little.
  const auto force = [&](const CondensedProblem& problem) {
    ContactState state;
    const auto scratch = std::make_unique<ContactScratch>();
    ContactOptions options;
    options.linearisations = 8;
    options.margin = contact_margin * 3e-3;
    return Vec3(solve_contact(problem, w->instruments(), moved.pose, h, options, state, *scratch)
                    .wrench[0]
                    .head<3>());
  };
  const Vec3 once = force(*refreshed);
  const double change = (once - force(*second)).norm();
  EXPECT_GT(change, 1e-3 * once.norm());
  ASSERT_TRUE(w->refresh(moved, *refreshed));
  EXPECT_LT((force(*refreshed) - once).norm(), 0.2 * change);
}

}  // namespace
}  // namespace hapticd
