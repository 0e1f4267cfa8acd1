// Pieces of one mesh touch one another as two bodies do.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "physics/simulation/body_contact/body_contact.h"
#include "tests/support/bodies.h"

namespace hapticd {
namespace {

constexpr double g = 9.81;
const Material soft{5e3, 0.4, 1000, 0, 2e-3};

BodySettings lower_block() {
  BodySettings b = block("lower", Vec3(0.012, 0.012, 6e-3), {4, 4, 3}, soft);
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  return b;
}

BodySettings upper_block() {
  return block("upper", Vec3(8e-3, 8e-3, 4e-3), {4, 4, 3}, soft,
               {Vec3(2e-3, 2e-3, 6.01e-3), Quat::Identity()});
}

// The second's nodes and tetrahedra after the first's.
BodySettings as_one(BodySettings a, const BodySettings& b) {
  const int first = static_cast<int>(a.mesh.nodes.size());
  a.mesh.nodes.insert(a.mesh.nodes.end(), b.mesh.nodes.begin(), b.mesh.nodes.end());
  for (Tet t : b.mesh.tets) {
    for (int& n : t) n += first;
    a.mesh.tets.push_back(t);
  }
  return a;
}

TEST(PieceContact, TwoPiecesOfOneMeshMoveAsTwoBodiesDo) {
  for (const double mu : {0.0, 0.3}) {
    WorldSettings s = contact_world({{0, 1, mu}, {1, 0, mu}});
    s.gravity = Vec3(mu > 0 ? 0.5 : 0, 0, -g);  // without friction it would slide off
    World two({upper_block(), lower_block()}, ball(1e-3), s);
    s.body_contact.pairs = {{0, 0, mu}};
    World one({as_one(lower_block(), upper_block())}, ball(1e-3), s);
    auto problem = std::make_unique<CondensedProblem>();
    const std::size_t lower = lower_block().mesh.nodes.size();
    double apart = 0, deepest = 0;
    for (int i = 0; i < 80; ++i) {
      const StepReport a = two.step(nobody, *problem), b = one.step(nobody, *problem);
      EXPECT_EQ(b.body_contact.status, SolveStatus::solved);
      EXPECT_FALSE(b.body_contact.capped);
      deepest = std::max(deepest, b.body_contact.penetration);
      for (std::size_t n = 0; n < two.bodies()[0].state.x.size(); ++n)
        apart = std::max(apart, (two.bodies()[0].state.x[n] - one.bodies()[0].state.x[lower + n]).norm());
    }
    std::printf("  mu %.1f: pieces and bodies %.1e m apart after 80 steps, deepest overlap %.1e m\n", mu,
                apart, deepest);
    EXPECT_LT(apart, 1e-7);
    EXPECT_LE(deepest, 1e-6);
    // It rests on the other: nobody else holds its weight.
    Vec3 held = Vec3::Zero();
    for (const BodyContact& c : one.contacts().contacts())
      held += (c.node >= static_cast<int>(lower) ? 1 : -1) * (c.frame * c.lambda);
    const double weight = mass_of(two.bodies()[0]) * g;
    EXPECT_LT((held - two.contacts().force_on(0)).norm(), 1e-6 * weight);
    // The tilted one stops in the last step before it sleeps, and so is held by more than its weight.
    if (mu == 0) {
      EXPECT_NEAR(held.z(), weight, 1e-3 * weight);
    }
  }
}

// A block whose middle layer goes: its halves see one another from that moment, and not before.
TEST(PieceContact, HalvesSeeOneAnotherOnceTheyAreApart) {
  Bodies bodies;
  BodySettings whole = block("block", Vec3(6e-3, 6e-3, 6e-3), {3, 3, 6}, soft);
  whole.removable = true;
  bodies.emplace_back(std::move(whole), 0.02, Vec3::Zero());
  BodyContactCandidateFinder finder({ContactPair{0, 0, 0}});
  const auto found = [&] {
    std::vector<BodyContactCandidate> out;
    finder.begin_step(bodies);
    finder.find(
        bodies, 0, [&](int b) { return std::span<const Vec3>(bodies[b].state.x); },
        [](int, int) { return 1.5e-3; }, 2e-3, 0, out);
    return out.size();
  };
  EXPECT_EQ(found(), 0u);
  const auto layer = [&](bool all) {
    std::vector<int> out;
    for (int t = 0; t < bodies[0].model.tet_count(); ++t) {
      Vec3 c = Vec3::Zero();
      for (const int n : bodies[0].model.mesh.tets[t]) c += 0.25 * bodies[0].rest()[n];
      if (bodies[0].state.alive[t] && c.z() > 2e-3 && c.z() < 3e-3 && (all || c.x() < 4e-3)) out.push_back(t);
    }
    return out;
  };
  take_out(bodies[0], layer(false));
  finder.surface_changed(0);
  EXPECT_EQ(found(), 0u);  // they hang together still
  take_out(bodies[0], layer(true));
  finder.surface_changed(0);
  EXPECT_EQ(found(), 32u);  // 4 × 4 nodes on either side
}

}  // namespace
}  // namespace hapticd
