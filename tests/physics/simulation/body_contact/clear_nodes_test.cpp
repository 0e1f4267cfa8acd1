// What is known to be clear of a surface is: theorems, and a search that knows nothing.
#include "physics/simulation/body_contact/clear_nodes.h"

#include <gtest/gtest.h>

#include <memory>
#include <random>

#include "physics/simulation/body_contact/contact_candidates.h"
#include "tests/physics/tissue/random_shapes.h"
#include "tests/support/bodies.h"

namespace hapticd {
namespace {

TEST(ClearNodes, ByHand) {
  ClearNodes clear;
  const std::vector<Vec3> y = {Vec3(0, 0, 0), Vec3(1, 0, 0)}, on = {Vec3(0, 0, 0.2), Vec3(1, 0, 0)};
  const Vec3 x(0, 0, 1);
  clear.follow(y);
  EXPECT_FALSE(clear.clear(7, x, 0, 0));  // nothing is known
  clear.set(7, x, 1);
  EXPECT_FALSE(clear.clear(6, x, 0, 0));
  EXPECT_TRUE(clear.clear(7, x, 0.99, 0));
  EXPECT_FALSE(clear.clear(7, x, 1, 0));
  EXPECT_TRUE(clear.clear(7, x + Vec3(0.3, 0, 0), 0.5, 0.19));
  EXPECT_FALSE(clear.clear(7, x + Vec3(0.3, 0, 0), 0.5, 0.21));
  // The surface comes by 0.2, and goes back: it may have been in the way of others meanwhile.
  clear.follow(on);
  EXPECT_TRUE(clear.clear(7, x, 0.79, 0));
  EXPECT_FALSE(clear.clear(7, x, 0.81, 0));
  clear.follow(y);
  EXPECT_FALSE(clear.clear(7, x, 0.61, 0));
  clear.forget();
  EXPECT_FALSE(clear.clear(7, x, 0, 0));
}

// A block that wanders about over another, both changing shape: a finder that has seen all of it, and one
// that sees the present alone, find the same.
TEST(ClearNodes, WhatIsLeftOutWouldNotHaveBeenFound) {
  for (const unsigned seed : {1U, 2U, 3U, 4U}) {
    std::mt19937 random(seed);
    const Material soft{5e3, 0.4, 1000, 0, 2e-3};
    Bodies bodies;
    bodies.emplace_back(
        block("upper", Vec3(6e-3, 6e-3, 3e-3), {4, 4, 2}, soft, {Vec3(3e-3, 3e-3, 7e-3), Quat::Identity()}),
        0.02, Vec3::Zero());
    bodies.emplace_back(block("lower", Vec3(0.012, 0.012, 6e-3), {5, 5, 3}, soft), 0.02, Vec3::Zero());
    const std::vector<Vec3> rest[2] = {bodies[0].state.x, bodies[1].state.x};
    BodyContactCandidateFinder seasoned({ContactPair{0, 1, 0}});
    const double depth = 1e-3, margin = 2e-4;
    const auto found = [&](BodyContactCandidateFinder& finder) {
      std::vector<BodyContactCandidate> out;
      finder.begin_step(bodies);
      finder.find(
          bodies, 0, [&](int b) { return std::span<const Vec3>(bodies[b].state.x); },
          [&](int, int) { return margin; }, depth, 5e-5, out);
      return out;
    };
    Vec3 at = Vec3::Zero();
    int met = 0, apart = 0;
    for (int step = 0; step < 200; ++step) {
      at += random_vector(random, 1e-4) - Vec3(0, 0, at.z() > -1e-3 ? 2e-5 : -2e-5);
      for (int b = 0; b < 2; ++b)
        for (std::size_t n = 0; n < rest[b].size(); ++n)
          bodies[b].state.x[n] =
              rest[b][n] + (b == 0 ? at : Vec3(Vec3::Zero())) + random_vector(random, 1e-5);
      BodyContactCandidateFinder fresh({ContactPair{0, 1, 0}});
      const auto known = found(seasoned), all = found(fresh);
      ASSERT_EQ(known.size(), all.size()) << seed << " " << step;
      for (std::size_t k = 0; k < all.size(); ++k) {
        EXPECT_EQ(known[k].node, all[k].node);
        EXPECT_EQ(known[k].gap, all[k].gap);
        EXPECT_EQ(known[k].faces, all[k].faces);
      }
      (all.empty() ? apart : met) += 1;
    }
    EXPECT_GT(met, 20);
    EXPECT_GT(apart, 20);
  }
}

}  // namespace
}  // namespace hapticd
