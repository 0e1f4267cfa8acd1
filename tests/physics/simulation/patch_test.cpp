#include "physics/simulation/patch.h"

#include <algorithm>
#include <numbers>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

TEST(Samples, DivideATriangleEvenly) {
  for (int k = 1; k <= 16; ++k) {
    const auto& weights = sample_weights(k);
    ASSERT_EQ(static_cast<int>(weights.size()), k * k);
    std::array<double, 3> mean = {0, 0, 0};
    for (const auto& w : weights) {
      EXPECT_NEAR(w[0] + w[1] + w[2], 1, 1e-14);
      for (int c = 0; c < 3; ++c) {
        EXPECT_GE(w[c], 1.0 / (3 * k) - 1e-14) << "no sample on an edge";
        mean[c] += w[c] / (k * k);
      }
    }
    for (double m : mean) EXPECT_NEAR(m, 1.0 / 3, 1e-13);
  }
}

TEST(Samples, OneForEachSpacingSquared) {
  const Vec3 a(0, 0, 0), b(1e-3, 0, 0), c(0, 1e-3, 0);
  for (const double spacing : {1e-3, 3e-4, 1e-4}) {
    const int k = subdivisions(a, b, c, spacing);
    EXPECT_GE(k * k, 0.5e-6 / (spacing * spacing));
    EXPECT_LT((k - 1) * (k - 1), 0.5e-6 / (spacing * spacing));
  }
}

struct Scene {
  Bodies bodies;
  Instrument instrument;
  double alarm_distance = 8e-4;

  Scene() {
    BodySettings soft{"soft", true, box_mesh(Vec3(8e-3, 8e-3, 4e-3), 6, 6, 3), {3000, 0.45, 1000, 0, 0}, {},
                      0.3,    true};
    soft.fixed_nodes = soft.mesh.group("bottom")->nodes;
    BodySettings hard{"hard", false, box_mesh(Vec3(8e-3, 8e-3, 1e-3), 4, 4, 1), {}, {}, 0, false};
    for (Vec3& x : hard.mesh.nodes) x.z() += 5e-3;
    bodies.emplace_back(std::move(soft), 0.02, Vec3::Zero());
    bodies.emplace_back(std::move(hard), 0.02, Vec3::Zero());
    Primitive tip;
    tip.shape = Shape::sphere;
    tip.radius = 4e-4;
    Primitive shaft;
    shaft.shape = Shape::capsule;
    shaft.radius = 2e-4;
    shaft.half_length = 2e-3;
    shaft.placement.p = Vec3(0, 0, 2e-3);
    instrument.primitives = {tip, shaft};
  }
};

// Every face with a sample nearer than the alarm distance must be found, wherever the instrument is.
TEST(Collision, FindsEveryFaceWithinReach) {
  Scene scene;
  Collision collision(scene.instrument, scene.alarm_distance);
  for (const Body& b : scene.bodies) collision.add_body(b.surface.faces(), b.state.x);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(0, 8e-3);
  std::vector<NearFace> near;
  int found = 0;
  for (int trial = 0; trial < 200; ++trial) {
    if (trial % 50 == 25) {  // deform and refit
      for (Vec3& x : scene.bodies[0].state.x) x += 2e-4 * Vec3::Random();
      collision.refit(0, scene.bodies[0].state.x);
    }
    const Pose X{Vec3(u(random), u(random), u(random)), Quat::UnitRandom()};
    collision.near_faces(X, near);
    std::set<std::pair<int, int>> reported;
    for (const NearFace& f : near) reported.insert({f.body, f.face});
    EXPECT_EQ(reported.size(), near.size());
    for (int b = 0; b < 2; ++b) {
      const Body& body = scene.bodies[b];
      for (std::size_t f = 0; f < body.surface.faces().size(); ++f) {
        const Triangle& t = body.surface.faces()[f].nodes;
        for (const auto& w : sample_weights(4)) {
          const Vec3 p = w[0] * body.state.x[t[0]] + w[1] * body.state.x[t[1]] + w[2] * body.state.x[t[2]];
          if (gap_at(scene.instrument, X, p).distance < scene.alarm_distance - 1e-6) {
            EXPECT_TRUE(reported.contains({b, static_cast<int>(f)})) << "body " << b << " face " << f;
            ++found;
            break;
          }
        }
      }
    }
  }
  EXPECT_GT(found, 500);
}

TEST(Patch, SamplesAreMaterialPointsOfBothBodies) {
  Scene scene;
  Collision collision(scene.instrument, scene.alarm_distance);
  for (const Body& b : scene.bodies) collision.add_body(b.surface.faces(), b.state.x);
  const Pose X{Vec3(4e-3, 4e-3, 4.5e-3), Quat::Identity()};  // between the block's top and the plate
  std::vector<NearFace> near;
  collision.near_faces(X, near);
  PatchGatherer gatherer(1.5e-4);
  auto problem = std::make_unique<CondensedProblem>();
  gatherer.gather(scene.bodies, scene.instrument, X, scene.alarm_distance, near, *problem);
  set_patch_positions(scene.bodies, gatherer.nodes(), *problem);
  ASSERT_GT(problem->samples, 20);
  int rigid = 0, soft = 0;
  for (int i = 0; i < problem->samples; ++i) {
    const PatchSample& s = problem->sample[i];
    if (i > 0) {
      EXPECT_LT(problem->sample[i - 1].id, s.id);
    }
    EXPECT_NEAR(s.outward.norm(), 1, 1e-12);
    if (s.node[0] < 0) {
      ++rigid;
      EXPECT_EQ(s.friction, 0);
      EXPECT_GE(s.free.z(), 5e-3 - 1e-12);
    } else {
      ++soft;
      EXPECT_EQ(s.friction, 0.3);
      for (int n : s.node) EXPECT_LT(n, problem->nodes);
    }
  }
  EXPECT_GT(rigid, 5);
  EXPECT_GT(soft, 5);
}

// A fine floor that the tip held down and has just left: what springs back comes before what is only near.
TEST(Patch, WhatTheTipHeldDownHasAPlaceWhereNotAllNodesHaveOne) {
  Bodies bodies;
  BodySettings floor{"floor", true, box_mesh(Vec3(4e-3, 4e-3, 1e-3), 20, 20, 2), {3000, 0.45, 1000, 0, 0}, {},
                     0,       true};
  floor.fixed_nodes = floor.mesh.group("bottom")->nodes;
  bodies.emplace_back(std::move(floor), 0.02, Vec3::Zero());
  Body& body = bodies.back();
  std::set<int> held;
  for (int n = 0; n < body.model.node_count(); ++n) {
    Vec3& x = body.state.x[n];
    const double aside = (x - Vec3(2e-3, 2e-3, x.z())).norm();
    if (x.z() < 0.99e-3 || aside > 0.45e-3) continue;
    held.insert(n);
    x.z() -= 0.6e-3;
    body.free.dx[3 * n + 2] = 0.6e-3;
  }
  ASSERT_GT(held.size(), 10u);
  Instrument instrument;
  Primitive tip;
  tip.shape = Shape::sphere;
  tip.radius = 0.6e-3;
  instrument.primitives = {tip};
  const Pose X{Vec3(2e-3, 2e-3, 1.55e-3), Quat::Identity()};
  Collision collision(instrument, 0.8e-3);
  collision.add_body(body.surface.faces(), body.state.x);
  std::vector<NearFace> near;
  collision.near_faces(X, near);
  PatchGatherer gatherer(2e-4);
  auto problem = std::make_unique<CondensedProblem>();
  gatherer.gather(bodies, instrument, X, 0.8e-3, near, *problem);
  EXPECT_GT(problem->dropped_samples, 0);
  EXPECT_LE(problem->nodes, max_patch_nodes);
  std::size_t found = 0;
  for (const PatchNode& n : gatherer.nodes()) found += held.contains(n.node);
  EXPECT_EQ(found, held.size());
}

// A rod that lies on a fine floor would fill the patch by itself; beside it the other's tip has all that it reaches.
TEST(Patch, BothInstrumentsHaveTheirFacesWhereOneAloneWouldFillIt) {
  Bodies bodies;
  bodies.emplace_back(BodySettings{"floor", true, box_mesh(Vec3(16e-3, 8e-3, 1e-3), 64, 32, 1), {3000, 0.45, 1000, 0, 0},
                                   {}, 0, true},
                      0.02, Vec3::Zero());
  const Body& body = bodies.back();
  Primitive rod;
  rod.shape = Shape::capsule;
  rod.radius = 0.6e-3;
  rod.half_length = 4e-3;
  rod.placement.q = Quat(Eigen::AngleAxisd(std::numbers::pi / 2, Vec3::UnitY()));
  Primitive tip;
  tip.shape = Shape::sphere;
  tip.radius = 0.3e-3;
  std::vector<Instrument> instruments(2);
  instruments[0].primitives = {rod};
  instruments[1].primitives = {tip};
  InstrumentPoses X(Pose{Vec3(6e-3, 4e-3, 1.3e-3), Quat::Identity()});
  X[1] = {Vec3(14e-3, 4e-3, 1.2e-3), Quat::Identity()};
  constexpr double alarm = 0.5e-3;
  const auto gathered = [&](bool first, bool second) {
    X.present[0] = first;
    X.present[1] = second;
    Collision collision(instruments, alarm);
    collision.add_body(body.surface.faces(), body.state.x);
    std::vector<NearFace> near;
    collision.near_faces(X, near);
    PatchGatherer gatherer(2e-4);
    auto problem = std::make_unique<CondensedProblem>();
    gatherer.gather(bodies, instruments, X, alarm, near, *problem);
    return problem;
  };
  const auto has = [](const CondensedProblem& problem, std::uint64_t id) {
    return std::any_of(problem.sample.begin(), problem.sample.begin() + problem.samples,
                       [&](const PatchSample& s) { return s.id == id; });
  };
  const auto rod_alone = gathered(true, false), tip_alone = gathered(false, true), both = gathered(true, true);
  EXPECT_GT(rod_alone->dropped_samples, 0);
  EXPECT_EQ(tip_alone->dropped_samples, 0);
  ASSERT_GT(tip_alone->samples, 20);
  for (const CondensedProblem* one : {rod_alone.get(), tip_alone.get()})
    for (int k = 0; k < one->samples; ++k) EXPECT_TRUE(has(*both, one->sample[k].id));
  EXPECT_EQ(both->samples, rod_alone->samples + tip_alone->samples);
}

}  // namespace
}  // namespace hapticd
