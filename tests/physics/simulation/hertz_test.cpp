// Hertz: a rigid sphere on a large soft block, by contact of bodies; force against depth, and how fast
// refining the mesh approaches it.
//
//   F = 4/3 E/(1 − ν²) √R d^{3/2},   contact radius a = √(R d)
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "tests/support/bodies.h"

namespace hapticd {
namespace {

constexpr double E = 10e3, nu = 0.3, R = 10e-3;

double hertz(double d) { return 4.0 / 3 * E / (1 - nu * nu) * std::sqrt(R * d * d * d); }

// A block below z = 0 of n × n × n/2 cells, its nodes drawn together about the origin: x = half sinh(β
// s)/sinh β, s even. All sizes fall alike with n.
BodySettings large_block(int n, double half) {
  const double beta = 5.3;
  BodySettings b =
      block("block", Vec3(2, 2, 1), {n, n, n / 2}, {E, nu, 1000, 0, 0}, {Vec3(-1, -1, -1), Quat::Identity()});
  for (Vec3& p : b.mesh.nodes) p = half / std::sinh(beta) * (beta * p.array()).sinh().matrix();
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  return b;
}

// The sphere's lower cap as a plate whose nodes lie on it, `d` deep.
BodySettings cap(double reach, int n, double d) {
  BodySettings b =
      slab("sphere", Vec3(2 * reach, 2 * reach, 1), {n, n, 1}, {Vec3(-reach, -reach, 0), Quat::Identity()});
  for (Vec3& p : b.mesh.nodes)
    p.z() = p.z() > 0.5 ? 2e-3 : R - d - std::sqrt(R * R - p.x() * p.x() - p.y() * p.y());
  return b;
}

double force(double d, int n) {
  const double a = std::sqrt(R * d);
  WorldSettings s = contact_world({{0, 1, 0}});
  s.h = 10;  // quasi-static
  World world({large_block(n, 60 * a), cap(2.5 * a, 60, d)}, ball(1e-3), s);
  auto problem = std::make_unique<CondensedProblem>();
  const StepReport r = world.step([] { return nobody(); }, *problem);
  EXPECT_EQ(r.body_contact.dropped, 0);
  EXPECT_LT(r.body_contact.penetration, 1e-3 * d);
  return world.contacts().force_on(1).z();
}

TEST(Hertz, ForceAgainstDepthIsReachedByRefinement) {
  const double d = 25e-6;
  const int cells[] = {24, 34, 48};
  double error[3];
  for (int k = 0; k < 3; ++k) {
    const double f = force(d, cells[k]);
    error[k] = f / hertz(d) - 1;
    std::printf("  depth %.0f um, elements of %.2f contact radii: %.5f mN, Hertz %.5f mN: %+.2f %%\n",
                1e6 * d, 60 * std::sinh(5.3 * 2 / cells[k]) / std::sinh(5.3), 1e3 * f, 1e3 * hertz(d),
                100 * error[k]);
  }
  std::printf("  order of refinement %.2f, %.2f\n", std::log(error[0] / error[1]) / std::log(34.0 / 24),
              std::log(error[1] / error[2]) / std::log(48.0 / 34));
  EXPECT_LT(std::abs(error[2]), 0.05);
  EXPECT_GT(std::log2(error[0] / error[2]),
            1);  // linear tetrahedra, and the edge of contact between two nodes
}

TEST(Hertz, ForceGoesWithDepthToThePowerOfThreeHalves) {
  double before = 0;
  for (const double d : {12.5e-6, 25e-6, 50e-6}) {
    const double f = force(d, 20);
    std::printf("  depth %.1f um: %.5f mN, Hertz %.5f mN\n", 1e6 * d, 1e3 * f, 1e3 * hertz(d));
    if (before > 0) {
      EXPECT_NEAR(std::log2(f / before), 1.5, 0.01);
    }
    before = f;
  }
}

}  // namespace
}  // namespace hapticd
