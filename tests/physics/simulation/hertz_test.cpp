// Hertz: a rigid sphere on a large soft block, by contact of bodies; force against depth, and how fast
// refining the mesh approaches it.
//
//   F = 4/3 E/(1 − ν²) √R d^{3/2},   contact radius a = √(R d)
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "tools/chart/tissue/tissue_analytic.h"
#include "tools/chart/tissue/tissue_hertz.h"

namespace hapticd {
namespace {

double hertz(double d) { return hertz_force(d, hertz_radius, hertz_young, hertz_poisson); }

double force(double d, int n) {
  const HertzResult r = hertz_by_bodies(d, n);
  EXPECT_EQ(r.dropped, 0);
  EXPECT_LT(r.penetration, 1e-3 * d);
  return r.force;
}

TEST(Hertz, ForceAgainstDepthIsReachedByRefinement) {
  const double d = 25e-6;
  const int cells[] = {24, 34, 48};
  double error[3];
  for (int k = 0; k < 3; ++k) {
    const double f = force(d, cells[k]);
    error[k] = f / hertz(d) - 1;
    std::printf("  depth %.0f um, %d cells: %.5f mN, Hertz %.5f mN: %+.2f %%\n", 1e6 * d, cells[k], 1e3 * f,
                1e3 * hertz(d), 100 * error[k]);
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
