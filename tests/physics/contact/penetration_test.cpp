// The published overlap is that of all samples, not of those that are rows.
#include <gtest/gtest.h>

#include "tests/support/contact_loop.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

// A ball of 2 mm comes from below: the sample's normal says that this is the tissue's inner side, so it is no
// row, and it is 1.5 mm inside the ball.
TEST(Penetration, CountsSamplesThatAreNoRows) {
  auto problem = spring_problem(100, Vec3::Zero(), 0);
  problem->alarm_distance = 3e-3;
  const Instrument ball = sphere_instrument(2e-3);
  Pose X;
  X.p = Vec3(0, 0, -0.5e-3);
  ContactLoop loop;
  const ContactSolution solution = loop.solve(*problem, ball, X);
  EXPECT_EQ(solution.contacts, 0);
  EXPECT_EQ(solution.wrench.norm(), 0);
  EXPECT_NEAR(solution.penetration, 1.5e-3, 1e-12);
  EXPECT_NEAR(solution.lost, 1.5e-3, 1e-12);
}

}  // namespace
}  // namespace hapticd
